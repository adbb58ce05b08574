"""Tables of a made-up study, and what its posterior files say of themselves."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from tests.shared.fake_records import Fake

from deabayes.experiment import Experiment, FloatArray
from deabayes.posteriors.storage import ATTRIBUTES, GROUPS
from deabayes.sampling.diagnostics import Failed

Draws = Mapping[str, tuple[FloatArray, FloatArray, Mapping[str, str]]]
"""By name: posterior (chains, draws), prior (1, draws), attributes."""


def errors(
    dataset: xr.Dataset, experiment: Experiment, fake: Fake, rng: np.random.Generator
) -> dict[str, object]:
    residual = experiment.response - dataset["median"].values
    e_rms = 100 * float(np.sqrt(np.mean(residual**2))) / experiment.response_range
    e_m = 100 * float(np.abs(residual).max()) / experiment.response_range
    return {
        "experiment": experiment.name,
        "role": experiment.role,
        "protocol": experiment.protocol,
        "e_rms_percent": e_rms,
        "e_rms_q05": 0.95 * e_rms,
        "e_rms_q95": 1.2 * e_rms,
        "e_m_percent": e_m,
        "e_m_q05": 0.9 * e_m,
        "e_m_q95": 1.3 * e_m,
        "coverage_50": 0.4 + 0.2 * rng.random(),
        "coverage_90": 0.8 + 0.2 * rng.random(),
        "crps": float(np.abs(residual).mean()),
        "pit_p": 0.5 if experiment.role == "calibrate" else 0.001,
        "extrapolation": dataset.attrs["extrapolation"],
    }


def summary_of(draws: Draws, fake: Fake) -> pd.DataFrame:
    rows = {}
    for name, (posterior, prior, attributes) in draws.items():
        bad = not fake.converged and name == "mu_alpha"
        contraction = 1 - np.log(posterior).var() / np.log(prior).var()
        moved = fake.sensitivities.get(name, (0.08 * (1 - contraction), 0.08 * contraction))
        rows[name] = {
            "symbol": attributes["symbol"],
            "unit": attributes["unit"],
            "mean": posterior.mean(),
            "sd": posterior.std(),
            "median": np.median(posterior),
            "q05": np.quantile(posterior, 0.05),
            "q95": np.quantile(posterior, 0.95),
            "mcse_mean": posterior.std() / 30,
            "ess_bulk": 90.0 if bad else 900.0,
            "ess_tail": 700.0,
            "r_hat": 1.31 if bad else 1.003,
            "contraction": contraction,
            "prior_sensitivity": moved[0],
            "likelihood_sensitivity": moved[1],
            "converged": not bad,
        }
    return pd.DataFrame.from_dict(rows, orient="index")


def comparison(fake: Fake) -> pd.DataFrame:
    best = fake.candidates[-1]
    rows = [
        {
            "candidate": f"kv_gm_{n}",
            "order": n,
            "n_parameters": 9 + 2 * n,
            "log_evidence": -2000.0 - 60.0 * (best - n),
            "log_evidence_mcse": 0.2,
            "bic": 4000.0 + 110.0 * (best - n),
            "elpd_block_loo": -1980.0 - 55.0 * (best - n),
            "elpd_block_loo_se": 20.0,
            "elpd_leave_one_experiment_out": -2100.0 - 40.0 * (best - n),
            "worst_k_hat": 0.4,
            "converged": fake.converged,
            "verdict": fake.verdict
            if n == best
            else f"not chosen: elpd {-55 * (best - n)} (SE 9.1)",
        }
        for n in fake.candidates
    ]
    table = pd.DataFrame(rows)
    if not fake.converged:
        table["elpd_block_loo"] = np.nan
        table["verdict"] = "not ranked: not converged"
    return table


def _convergence(fake: Fake) -> dict[str, Any]:
    disagree = Failed("r_hat", "mu_alpha", "R-hat 1.310 is not below 1.01", 1.31)
    failed = [] if fake.converged else [disagree]
    return {
        "converged": fake.converged,
        "reasons": [str(each) for each in failed],
        "failed_gates": [asdict(each) for each in failed],
        "r_hat_max": 1.003 if fake.converged else 1.31,
        "ess_bulk_min": 900.0,
        "ess_tail_min": 700.0,
        "autocorrelation_times": [128.0, 140.0, 120.0, 9.0 if fake.converged else 1.0],
        "length": 29.0 if fake.converged else 3.9,
        "tau": 39.0,
        "steps": 5000,
        "walkers": 128,
        "ensembles": 4,
        "failures": {"evaluations": 100000, "failed": 20},
    }


def _specimen(fake: Fake) -> dict[str, Any]:
    return {
        "name": fake.name,
        "system": "tensile_strip",
        "provenance": {"kind": fake.provenance, "source": "made up for a test", "licence": "none"},
        "quantities": {
            "cross_section": {"value": 1e-5, "unit": "m^2", "sd": None, "source": "made up"}
        },
        "instruments": {},
    }


def attributes_of(fake: Fake, units: int, experiments: Sequence[Experiment]) -> dict[str, str]:
    sampling = {"ensembles": 4, "walkers": 128, "ess": 400, "r_hat": 1.01}
    settings = {
        "name": fake.name,
        "noise": fake.noise,
        "noise_scale": "absolute",
        "noise_groups": "protocol",
        "sampling": sampling,
    }
    records = [
        {"name": e.name, "protocol": e.protocol, "group": e.protocol, "scale": 1.0}
        for e in experiments
        if e.role == "calibrate"
    ]
    return {
        "study": json.dumps(settings),
        "study_name": fake.name,
        "candidate": f"kv_gm_{units}",
        "order": str(units),
        "system": "tensile_strip",
        "specimen": json.dumps(_specimen(fake)),
        "provenance": fake.provenance,
        "noise": fake.noise,
        "experiments": json.dumps(records),
        "convergence": json.dumps(_convergence(fake)),
        "warnings": json.dumps(list(fake.warnings)),
        "deabayes_version": "0.1.0",
    }


def whole(tree: xr.DataTree) -> xr.DataTree:
    """The tree with what else a posterior file has, all of it empty."""
    missing = [name for name in GROUPS if name not in tree.children]
    given = {name: child.to_dataset() for name, child in tree.children.items()}
    result = xr.DataTree.from_dict(given | {name: xr.Dataset() for name in missing})
    result.attrs = dict.fromkeys(ATTRIBUTES, "") | tree.attrs
    return result
