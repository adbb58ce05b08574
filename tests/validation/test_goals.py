"""The table of goals says yes, NO or nothing as the stored figures have it."""

import pandas as pd
import pytest

from tests.validation import goals, recovery_summary


def found(folder):
    goals.write(folder)
    return pd.read_csv(folder / goals.FILE, keep_default_na=False)


def met(table, goal):
    return list(table.loc[table["goal"].str.startswith(goal), "met"])


def test_what_was_not_run_is_neither_met_nor_missed(tmp_path):
    table = found(tmp_path)
    assert met(table, "1") == ["by make test"]
    rest = table[~table["goal"].str[0].isin(["1", "2"])]
    assert set(rest["met"]) == {""}
    assert set(rest["measured"]) == {"not measured yet"}
    assert {goal[0] for goal in table["goal"]} == set("12345678")


def test_the_figures_of_a_goal_are_counted():
    rows = {"goal": [*["6 a"] * 4, "1 b"], "asked": ["x", "x", "y", "y", "z"], "of": list("abcde")}
    rows["measured"] = ["0.9", "0.1", goals.NOT_RUN, "0.8", "at every change"]
    rows["met"] = ["yes", "NO", "", "yes", goals.BY_TESTS]
    counts = ["figures", "as asked", "missed", "not measured"]
    table = goals.overview(pd.DataFrame(rows)).set_index("goal")
    assert list(table.loc["6 a", counts]) == [4, 2, 1, 1]
    assert list(table.loc["1 b", counts]) == [1, 1, 0, 0]
    assert list(table["asked"]) == ["x; y", "z"]


@pytest.mark.parametrize(
    ("mean", "end", "expected"), [(0.09, 0.14, "yes"), (0.11, 0.1, "NO"), (0.05, 0.16, "NO")]
)
def test_seeds_that_disagree_are_seen(tmp_path, mean, end, expected):
    rows = {"model": ["a"], "both_converged": [1]}
    rows |= {"mean_difference_sd": [mean], "end_difference_sd": [end]}
    pd.DataFrame(rows).to_csv(tmp_path / "two_seeds.csv", index=False)
    assert met(found(tmp_path), "5") == [expected]


def test_a_set_that_passes_its_gates_and_is_off_is_named(tmp_path):
    rows = {"set": ["Misra1a", "MGH17", "Lanczos1"], "converged": ["yes", "yes", "no"]}
    rows |= {"mean - exact [sd]": [0.01, 0.0, 5.0], "sd / exact": [1.02, 0.94, 2.0]}
    pd.DataFrame(rows).to_csv(tmp_path / "nist_summary.csv", index=False)
    table = found(tmp_path)
    assert met(table, "8") == ["NO", "NO", "NO"]
    assert list(table.loc[table["goal"].str.startswith("8"), "measured"])[1:] == [
        "MGH17",
        "Lanczos1",
    ]


@pytest.mark.parametrize(
    ("world", "right", "wrong", "surplus", "expected"),
    [
        ("shown", 0.95, 2, 2, ["yes", "yes"]),
        ("shown", 0.94, 3, 3, ["NO", "NO"]),
        ("shown_discrepancy", 0.80, 0, 0, ["yes", "yes"]),
        ("shown_discrepancy", 0.95, 1, 0, ["NO", "yes"]),
    ],
)
def test_orders_and_surplus_units(tmp_path, world, right, wrong, surplus, expected):
    rows = {"family": ["m"], "world": world, "true units": 2, "specimens": 100}
    rows |= {"surplus unit": surplus, "last unit is shown": 40}
    rows |= {"wrong": 9, "wrong without caution": wrong}
    pd.DataFrame({**rows, "share right": right}).to_csv(
        tmp_path / "order_selection.csv", index=False
    )
    assert met(found(tmp_path), "6") == ["", *expected]


@pytest.mark.parametrize(("share", "expected"), [(0.90, "yes"), (0.85, "NO"), (0.95, "NO")])
def test_coverage_and_its_control(tmp_path, share, expected):
    right, wrong = "OU + white noise, fitted as such", "fitted as independent noise (must fail)"
    band = {"90 % band covers sine": [0.9, 0.2], "50 % band covers sine": [0.5, 0.1]}
    rows = {"data and fit": [right, f"the same data, {wrong}"], "units": [1, 1]}
    rows |= {"replicates": [100, 100], "coverage of 90 % intervals": [f"{share} (0.8 to 1)", 0.7]}
    pd.DataFrame({**rows, **band}).to_csv(tmp_path / "membrane_recovery.csv", index=False)
    table = found(tmp_path)
    membranes = table[table["of"].str.startswith("membrane, kv_gm_1")]
    assert [answer for answer in met(membranes, "4") if answer] == [expected, "yes"]
    assert [answer for answer in met(membranes, "7") if answer] == ["yes"]


@pytest.mark.parametrize(
    ("change", "width", "expected"),
    [("+0.020 ± 0.015", 1.2, ["yes", "yes"]), ("-0.050 ± 0.015", 1.3, ["NO", "NO"])],
)
def test_sampling_faster_and_noise_that_is_not_there(tmp_path, change, width, expected):
    names = [recovery_summary.MEANING[variant] for variant in ("ou", "dense", "iid")]
    rows = {"data and fit": names, "units": 1, "replicates": 100}
    rows |= {"coverage of 90 % intervals": "0.9 (0.8 to 1)"}
    rows |= {recovery_summary.WIDTHS: [None, None, width]}
    rows |= {recovery_summary.CHANGE: [None, change, None]}
    pd.DataFrame(rows).to_csv(tmp_path / "membrane_recovery.csv", index=False)
    asked = found(tmp_path)
    faster = asked[asked["asked"].str.startswith("five times faster")]
    assert list(faster["met"]) == expected
    assert list(faster["measured"]) == [f"{change}, 100 specimens", f"{width:.2f}, 100 specimens"]


def test_the_same_specimens_are_compared():
    """Of four, two are sampled faster: one interval of four gains the truth, whatever others do."""
    usual = pd.DataFrame(
        {"replicate": [0, 1, 2, 3], "rank:mu": 1, "rank:tau": 1, "in90:mu": [1, 0, 0, 0]}
        | {"in90:tau": [1, 1, 0, 0]}
    )
    dense = usual.iloc[:2].assign(**{"in90:mu": [1, 1]})
    change = recovery_summary.change_of_coverage(
        {("dense", 1): dense, ("ou", 1): usual}, "dense", 1
    )
    assert change == "+0.250 ± 0.250"
