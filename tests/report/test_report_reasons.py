"""Why a candidate did not converge: a sentence per gate, and one advice."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from deabayes.report.notices import grouped
from deabayes.sampling.diagnostics import Failed

SAMPLING = {"max_steps": 400, "ess": 400.0, "autocorrelation_times": 50.0}
STUCK = "2 of 48 walkers are stuck; start again with another seed"
INHERITED = "its prior is the posterior a/b_2/posterior.nc, which did not converge"
FAILED = [
    *(Failed("r_hat", name, f"R-hat {value:.3f} is not below 1.01", value)
      for name, value in (("mu_1", 1.02), ("tri.sigma_ou", 1.033), ("J", 1.011))),
    Failed("stuck", "run 1", STUCK, 2.0, longer=False),
    *(Failed("ess_bulk", name, f"rests on {size} effective draws", -size)
      for name, size in (("mu_1", 157.0), ("J", 88.0))),
    Failed("length", "the runs", "only 9 autocorrelation times long", -9.0),
]  # fmt: skip
MEASURED = {"length": 10.0, "ess_bulk_min": 88.0, "ess_tail_min": 300.0}


def stored(*failed: Failed, others: tuple[str, ...] = ()) -> dict[str, object]:
    return {
        "reasons": [*map(str, failed), *others],
        "failed_gates": [asdict(each) for each in failed],
    }


def test_a_gate_is_said_once_with_its_worst_and_the_advice_last() -> None:
    found = grouped(stored(*FAILED, others=(INHERITED,)) | {"steps": 410, **MEASURED}, SAMPLING)
    assert found == [
        "tri.sigma_ou: R-hat 1.033 is not below 1.01 (the worst of 3)",
        f"run 1: {STUCK}",
        "J: rests on 88.0 effective draws (the worst of 2)",
        "the runs: only 9 autocorrelation times long",
        INHERITED,
        "Sample longer: set sampling.max_steps to 2100 or more (now 400), by what the runs "
        "tell so far of their autocorrelation time; docs/how-to/not-converged.md",
    ]


@pytest.mark.parametrize(
    ("measured", "said"),
    [
        ({"steps": 400, "length": 45.0}, "to 800 or more"),
        ({"steps": 400, "ess_tail_min": 20.0}, "to 8000 or more"),
        ({}, "double sampling.max_steps"),
    ],
)
def test_the_steps_advised(measured: dict[str, float], said: str) -> None:
    assert said in grouped(stored(FAILED[0]) | measured, SAMPLING)[-1]


def test_no_longer_runs_where_they_do_not_help() -> None:
    assert grouped(stored(FAILED[3], others=(INHERITED,)), SAMPLING) == [
        f"run 1: {STUCK}",
        INHERITED,
    ]
    assert grouped({}, {}) == []
