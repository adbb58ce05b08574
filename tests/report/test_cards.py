"""Cards of the first screen: which quantities, errors and cautions they show."""

from __future__ import annotations

from fnmatch import fnmatchcase
from types import SimpleNamespace

import pandas as pd
import pytest
from tests.report.test_tables import NAN, candidate
from tests.shared.cards import posterior

from deabayes.export.source import system_and_draws
from deabayes.report import cards
from deabayes.report.notices import TOO_NARROW, Notice


def results(system: str, **kinds: str) -> SimpleNamespace:
    """A candidate with quantities of these kinds, in this order."""
    return SimpleNamespace(
        study=SimpleNamespace(system=system),
        summary=pd.DataFrame(index=list(kinds)),
        names=lambda *wanted: [name for name, kind in kinds.items() if kind in wanted],
    )


@pytest.mark.parametrize(
    ("system", "expected"),
    [
        (
            "membrane",
            ["mu_alpha", "relaxation_time_1", "relaxation_time_2", "zeta_alpha", "J_alpha"],
        ),
        ("my_own", ["zeta_alpha", "mu_alpha", "J_alpha", "thickness"]),
    ],
)
def test_the_system_says_which_quantities_come_first(system: str, expected: list[str]) -> None:
    made = results(
        system,
        zeta_alpha="material", mu_alpha="material", J_alpha="material", thickness="specimen",
        relaxation_time_1="derived", relaxation_time_2="derived",
    )  # fmt: skip
    made.names = lambda *wanted, names=made.names: [*names(*wanted), "not_in_the_table"]
    assert cards.key_quantities(made) == expected
    made.summary = None
    assert cards.key_quantities(made) == []


@pytest.mark.parametrize(
    ("system", "candidate"),
    [
        ("membrane", "kv_gm_2"),
        ("tensile_strip", "kv_gm_2"),
        ("minimum_energy_structure", "ogden_2_units_2"),
        ("tubular", "voigt_kelvin_2"),
    ],
)
def test_the_names_that_a_system_puts_first_exist(system: str, candidate: str) -> None:
    built, draws = system_and_draws(posterior(system, candidate, size=20))
    names = {*draws, *built.derived(draws)}
    found = [any(fnmatchcase(name, pattern) for name in names) for pattern in built.headline]
    only_of_variants = {"resonance_frequency", "electrical_time_constant"}
    assert found == [pattern not in only_of_variants for pattern in built.headline]
    assert len(found) > 2


def test_errors_are_the_mean_and_the_worst_record() -> None:
    made = candidate()
    made.errors.loc[made.errors["experiment"] == "c", "e_rms_percent"] = 2.0
    fitted, held_out = cards.errors(made)
    assert fitted == {
        "records": "1 fitted", "e_rms": ("1.2 %", ""), "coverage": ("30 %", ""), "failed": True
    }  # fmt: skip
    assert held_out["records"] == "2 held out"
    assert held_out["e_rms"] == ("1.6 %", "worst 2.0 %")
    assert held_out["coverage"] == ("70 %", "worst 69 %")
    assert held_out["failed"]
    made.errors = made.errors[1:].assign(coverage_90=NAN, role="validate")
    (unknown,) = cards.errors(made)
    assert unknown["coverage"] == ("–", "") and not unknown["failed"]


def test_cautions_are_about_the_recommended_candidate() -> None:
    def shown(title: str, candidate: str, serious: bool = True) -> bool:
        return cards._is_on_card(Notice("s", candidate, title, (), serious), "best")

    assert shown("Extrapolation", "best") and shown("Order not resolved", "")
    assert not shown("Not converged", "another")
    assert not shown("Data", "", serious=False)
    assert not shown(TOO_NARROW, "best")  # a failed check says it already


def test_cautions_name_records_and_parameters() -> None:
    details = ("a, b: too far", "c: too long", "5 of 9 evaluations failed: x", "and so on")
    assert cards.subjects(Notice("s", "", "t", details)) == "a, b, c"
    many = Notice("s", "", "t", tuple(f"r{k}: x" for k in range(6)))
    assert cards.subjects(many) == "r0, r1, r2, r3 and 2 more"
