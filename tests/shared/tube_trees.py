"""Posterior trees of made-up tubular actuators: nothing is fitted."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np
import xarray as xr
from tests.shared.tubes import QUANTITIES

from deabayes.experiment import FloatArray, Quantity, Specimen
from deabayes.posteriors.storage import specimen_to_json
from deabayes.systems import build

CENTRES = {"E_0": 1.5e6, "E_1": 12e6, "E_2": 6e6, "tau_1": 6e-3, "tau_2": 0.12}
CIRCUIT = {
    "series_resistance": Quantity(954.0, "ohm", 250.0),
    "leakage_resistance": Quantity(1e6, "ohm"),
    "capacitance": Quantity(180e-9, "F", 2e-9),
}
"""It leaks so much that the gain of a steady voltage is not one."""
CHAINS = 2


def specimen() -> Specimen:
    """The tube of `tubes`, its thickness and circuit uncertain."""
    thickness = {"thickness": Quantity(80e-6, "m", 2e-6)}
    delay = {"delay": Quantity(4e-4, "s")}
    kind = {"kind": "simulated"}
    return Specimen("tube", "tubular", kind, QUANTITIES | CIRCUIT | thickness, delay)


def tree(
    candidate: str,
    size: int = 6,
    spread: float = 0.1,
    converged: bool = True,
    of: Specimen | None = None,
    centres: Mapping[str, float] = CENTRES,
) -> xr.DataTree:
    """`CHAINS` ensembles of `size` draws each, scattered about the centres."""
    given = of or specimen()
    system = build(given.system, candidate, given)
    rng = np.random.default_rng(3)

    def drawn(name: str) -> FloatArray:
        stated = given.quantities[name].value if name in given.quantities else 1.0
        centre = centres.get(name, stated)
        return centre * np.exp(spread * rng.standard_normal((CHAINS, size)))

    draws = {
        p.name: (("chain", "draw"), drawn(p.name), {"unit": p.unit, "kind": "material"})
        for p in system.parameters()
    }
    result = xr.DataTree.from_dict({"posterior": xr.Dataset(draws)})
    result.attrs |= {
        "candidate": candidate,
        "system": given.system,
        "specimen": specimen_to_json(given),
        "provenance": given.provenance.get("kind", "measured"),
        "convergence": json.dumps({"converged": converged}),
        "deabayes_version": "0.1.0",
    }
    return result
