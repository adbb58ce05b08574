"""Why a candidate did not converge: a sentence per gate, and one advice."""

from __future__ import annotations

import pytest

from deabayes.report.reasons import grouped

SAMPLING = {"max_steps": 400, "ess": 400.0, "autocorrelation_times": 50.0}
REASONS = [
    *(f"{name}: R-hat {value:.3f} is not below 1.01: the independent runs disagree; sample longer"
      for name, value in (("mu_1", 1.02), ("tri.sigma_ou", 1.033), ("J", 1.011))),
    "run 1: 2 of 48 walkers are stuck (they did not move, or stay where the posterior is far lower "
    "than elsewhere); start again with another seed",
    *(f"{name}: the bulk of the distribution rests on {size} effective draws, fewer than 400; "
      "sample longer" for name, size in (("mu_1", 157), ("J", 88))),
    *(f"run {run}: only {times} autocorrelation times long, fewer than 50; sample longer"
      for run, times in ((1, 10), (2, 9))),
    "its prior is the posterior a/b_2/posterior.nc, which did not converge",
]  # fmt: skip
MEASURED = {"autocorrelation_times_min": 10.0, "ess_bulk_min": 88.0, "ess_tail_min": 300.0}


def test_a_gate_is_said_once_with_its_worst_and_the_advice_last() -> None:
    found = grouped({"reasons": REASONS, "steps": 410, **MEASURED}, SAMPLING)
    assert found == [
        "tri.sigma_ou: R-hat 1.033 is not below 1.01: the independent runs disagree (the worst of "
        "3)",
        REASONS[3],
        "J: the bulk of the distribution rests on 88 effective draws, fewer than 400 (the worst of "
        "2)",
        "run 2: only 9 autocorrelation times long, fewer than 50 (the worst of 2)",
        REASONS[-1],
        "Sample longer: set sampling.max_steps to 2100 or more (now 400), by what the runs "
        "tell so far of their autocorrelation time; docs/how-to/not-converged.md",
    ]


@pytest.mark.parametrize(
    ("measured", "said"),
    [
        ({"steps": 400, "autocorrelation_times_min": 45.0}, "to 800 or more"),
        ({"steps": 400, "ess_tail_min": 20.0}, "to 8000 or more"),
        ({}, "double sampling.max_steps"),
    ],
)
def test_the_steps_advised(measured: dict[str, float], said: str) -> None:
    assert said in grouped({"reasons": REASONS[:1], **measured}, SAMPLING)[-1]


def test_no_longer_runs_where_they_do_not_help() -> None:
    assert grouped({"reasons": REASONS[-1:]}, SAMPLING) == REASONS[-1:]
    assert grouped({}, {}) == []
