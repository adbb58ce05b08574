"""Export of linear models for control: A, B, C, D of draws, as JSON or MATLAB files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from deabayes.experiment import FloatArray, Specimen
from deabayes.export.source import converged, evenly, identity, system_and_draws
from deabayes.faults import UserError
from deabayes.integrate.state_space import StateSpace
from deabayes.quantities import with_unit
from deabayes.systems import Draws, System
from deabayes.systems.solid import LinearModel, Signal
from deabayes.units import parse_quantity

DRAWS, GRAM = 200, 1e-3
FITTED_DELAY = "sensor_delay"
OWN_DELAYS = ("strain.delay", "displacement.delay", "phase.delay")
AXES = ("draw", "row", "column")
"""Axes of A, B, C and D, in every file format."""
STEPS_PER_PERIOD = 10.0
"""Recommended number of samples per period of a resonance."""
DISCRETISATION = "zero-order hold: exact for an input held between samples (matrix exponential)"


def write(
    tree: xr.DataTree,
    path: Path,
    *,
    suffix: str,
    rate: str | float | None = None,
    draws: int | None = None,
    load_g: float = 0.0,
    bias: str | float | None = None,
) -> Sequence[str]:
    """Write x' = A x + B u, y = C x + D u of draws taken evenly from all ensembles.

    Parameters
    ----------
    suffix : `.json` or `.mat`, the file's format. The axes of the matrices are draw, row, column
        in both.
    rate : sample rate of the discrete model, e.g. ``"10 kHz"``; by default there is none.
    draws : number of draws; 200 by default, or all if there are fewer.
    load_g : mass of the hanging load [g].
    bias : voltage about which the model is linearised, e.g. ``"2 kV"``. By default the input is
        the squared voltage, in which the model is linear without an approximation.

    Returns
    -------
    list of str
        A warning if the sample rate is too low for the model's resonance; else empty.

    Raises
    ------
    UserError
        If the system has no linear model, or an option has an impossible value.
    """
    if suffix not in WRITERS:
        raise UserError(
            f"--to state-space writes {' or '.join(WRITERS)} files; end the name after -o with "
            f"one of these, found {suffix or 'no ending'!r}"
        )
    hertz, volts = _positive(rate, "Hz", "--rate"), _positive(bias, "V", "--bias")
    total = tree["posterior"].sizes["chain"] * tree["posterior"].sizes["draw"]
    picked = evenly(total, min(DRAWS, total) if draws is None else draws)
    system, all_draws = system_and_draws(tree)
    values = {name: drawn[picked] for name, drawn in all_draws.items()}
    model = _linear_model(system, values, load_g, volts)
    content = _content(tree, system, model, GRAM * load_g)
    content |= {"draws": _draws(tree, system, values, picked), "continuous": _matrices(model.space)}
    if hertz is not None:
        content["discrete"] = {
            "sample_time": {"unit": "s", "value": 1.0 / hertz},
            "discretisation": DISCRETISATION,
            **_matrices(model.space.zero_order_hold(1.0 / hertz)),
        }
    WRITERS[suffix](content, path)
    return [] if hertz is None else _too_slow(model.space, hertz)


def _positive(given: str | float | None, unit: str, option: str) -> float | None:
    if given is None:
        return None
    value = parse_quantity(given, unit, option)
    if not 0.0 < value < np.inf:
        raise UserError(f"{option} must be above zero and finite; found {given!r}")
    return value


def _linear_model(system: System, values: Draws, load_g: float, bias: float | None) -> LinearModel:
    """Return the linear model of a system; refuse systems without one, or non-finite matrices."""
    if not 0.0 <= load_g < np.inf:
        raise UserError(f"--load-g must be a mass in g of zero or more; found {load_g:g}")
    model = system.linear_model(values, GRAM * load_g, bias)
    if model is None:
        raise UserError(
            f"{system.candidate} of system {system.name!r} has no linear model, so it has no "
            "state space; export its draws with --to json or --to mat"
        )
    space = model.space
    columns = np.column_stack([space.a.reshape(len(space.a), -1), space.b, space.c, space.d])
    lost = int(np.sum(~np.all(np.isfinite(columns), axis=1)))
    if lost:
        raise UserError(
            f"the matrices of {lost} of {len(columns)} draws are not finite; look at the "
            "posterior's draws with --to csv"
        )
    return model


def _content(
    tree: xr.DataTree, system: System, model: LinearModel, load: float
) -> dict[str, object]:
    """Return the description of the model: origin, equations, signals, operating point."""
    simulated = tree.attrs["provenance"] == "simulated"
    content: dict[str, object] = {
        **identity(tree),
        "provenance_note": "from simulated records, not from measurements" if simulated else "",
        "converged": converged(tree),
        "equations": "x' = A x + B u, y = C x + D u; discrete: x[k+1] = A x[k] + B u[k]",
        "axes": list(AXES),
        "validity": model.validity,
        "input": _signals(model.input)[0],
        "output": _signals(model.output)[0],
        "states": _signals(*model.states),
        "load": {"unit": "kg", "value": load},
        "operating_point": {
            name: {"unit": at.unit, "description": at.description, "values": at.values}
            for name, at in model.operating_point.items()
        },
    }
    delay = _sensor_delay(system.specimen)
    return content | ({"sensor_delay": delay} if delay else {})


def _sensor_delay(specimen: Specimen) -> dict[str, object] | None:
    """Return the delay of the motion sensor; None if the specimen does not state one."""
    note = "delay of the sensor; the matrices do not contain it"
    quantity = specimen.quantities.get(FITTED_DELAY)
    if quantity is not None and quantity.sd is not None:
        note += f"; every draw has its own delay, {FITTED_DELAY} among its parameters"
        return {"unit": "s", "value": quantity.value, "sd": quantity.sd, "description": note}
    stated = (specimen.instruments.get(name) for name in (*OWN_DELAYS, "delay"))
    quantity = quantity or next((delay for delay in stated if delay is not None), None)
    if quantity is None:
        return None
    return {"unit": "s", "value": quantity.value, "description": note}


def _signals(*signals: Signal) -> list[dict[str, str]]:
    return [{"name": s.name, "unit": s.unit, "description": s.description} for s in signals]


def _draws(
    tree: xr.DataTree, system: System, values: Draws, picked: np.ndarray
) -> dict[str, object]:
    """Return the position of every draw in the posterior, and the draws' parameters."""
    ensemble, draw = np.divmod(picked, tree["posterior"].sizes["draw"])
    units = {parameter.name: parameter.unit for parameter in system.parameters()}
    parameters = {n: {"unit": units[n], "values": drawn} for n, drawn in values.items()}
    return {"ensemble": ensemble, "draw": draw, "parameters": parameters}


def _matrices(space: StateSpace) -> dict[str, FloatArray]:
    """Return A (W, n, n), B (W, n, 1), C (W, 1, n) and D (W, 1, 1)."""
    return {
        "A": space.a,
        "B": space.b[:, :, None],
        "C": space.c[:, None, :],
        "D": space.d[:, None, None],
    }


def _too_slow(space: StateSpace, rate: float) -> list[str]:
    """Warn if the model's fastest oscillation (median of draws) exceeds half the sample rate."""
    frequencies = np.abs(np.linalg.eigvals(space.a).imag).max(axis=1) / (2.0 * np.pi)
    resonance = float(np.median(frequencies))
    if resonance <= 0.5 * rate:
        return []
    enough = with_unit(STEPS_PER_PERIOD * resonance, "Hz", digits=3)
    return [
        f"--rate {rate:.4g} Hz is too low for the resonance at {resonance:.3g} Hz (median of the "
        "draws). The discrete model is right at its samples, but shows neither the oscillation "
        f"nor its frequency. Use {enough} or more to see both"
    ]


def write_json(content: Mapping[str, Any], path: Path) -> None:
    """Write arrays as nested lists, and numbers with all digits."""
    text = json.dumps(content, default=lambda array: array.tolist(), allow_nan=False)
    path.write_text(text, encoding="utf-8")


def write_mat(content: Mapping[str, Any], path: Path) -> None:
    """Write a struct `model`."""
    from scipy.io import savemat

    with path.open("wb") as stream:
        savemat(stream, {"model": _matlab(content)}, long_field_names=True)


def _matlab(value: Any) -> Any:
    """Return a value as savemat takes it, with lists as cells."""
    if isinstance(value, Mapping):
        return {name: _matlab(item) for name, item in value.items()}
    if isinstance(value, list):
        cells = np.empty(len(value), dtype=object)
        cells[:] = [_matlab(item) for item in value]
        return cells
    return value


WRITERS = {".json": write_json, ".mat": write_mat}
"""Ending of the file -> function that writes it."""
