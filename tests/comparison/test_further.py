"""Which experiment to do next: what is considered, which candidates, and which one wins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from tests.shared.contexts import experiment
from tests.shared.membranes import PLAIN, membrane, step

from deabayes.comparison.further import altered, contenders, faults, further_table, outlook, plan
from deabayes.faults import Faults
from deabayes.inference.record_noise import ResidualScale
from deabayes.noise import REGISTRY as NOISE
from deabayes.posteriors.fitted import Fitted
from deabayes.prediction.calibrated import CalibratedRecord

TIME = np.linspace(1.0, 60.0, 40)
SLOW = {
    "mu_alpha": 35e3, "zeta_alpha": 1e5, "J_alpha": 110.0, "J_beta": 55.0, "mu_beta_1": 15e3,
    "tau_beta_1": 4.0, "mu_beta_2": 15e3, "tau_beta_2": 3e3,
}  # fmt: skip
"""A second unit that a minute hardly shows."""
STIFFER = {"mu_alpha": 42e3}
"""What takes the second unit's place for a minute."""


def record(name="step_2kV", volts=2000.0, role="calibrate"):
    return experiment(name, "step", step(volts, last=60.0), TIME, "displacement", role)


def fitted(candidate, seed, count=150, calibrated=None):
    system = membrane(candidate)
    rng = np.random.default_rng(seed)
    names = [parameter.name for parameter in system.parameters()]
    values = SLOW | (STIFFER if system.order == 1 else {})
    draws = {n: values[n] * np.exp(0.003 * rng.standard_normal(count)) for n in names}
    draws["step.sigma_white"] = np.full(count, 9e-5)
    kept = (CalibratedRecord.of(calibrated or record(), "step", ResidualScale()),)
    return Fitted(
        candidate, PLAIN, system, NOISE["white"](), "absolute", "record", draws, kept, True
    )


def seed(name):
    return np.random.SeedSequence([1, *name.encode()])


def table_of(asked, candidates=("kv_gm_1", "kv_gm_2")):
    made = {name: fitted(name, index) for index, name in enumerate(candidates)}
    return further_table(plan([record(), record("more", 2200.0, "validate")], asked), made, seed)


@pytest.fixture(scope="module")
def weighed():
    return table_of(
        {
            "long": {"like": "step_2kV", "duration": 20},
            "again": {"like": "step_2kV"},
            "destroyed": {"like": "step_2kV", "excitation": 4},
        }
    ).set_index("experiment")


def test_the_experiment_that_shows_the_difference_wins(weighed):
    assert weighed.index[0] == "long"
    assert weighed.loc["long", "probability_right"] > 0.9
    assert weighed.loc["again", "probability_right"] < 0.85
    assert set(weighed.index) == {"long", "again", "more", "destroyed"}
    assert weighed["held_out"].to_dict() == {n: n == "more" for n in weighed.index}
    assert (weighed["candidates"] == "kv_gm_1, kv_gm_2").all()


def test_a_specimen_that_would_not_survive_is_said(weighed):
    row = weighed.loc["destroyed"]
    assert row["failed_share"] == 1.0 and "breakdown" in row["failure"]
    assert row["information_candidate_nats"] == 0.0 and row["probability_right"] == 0.5
    assert np.isnan(row["information_kv_gm_1_nats"])
    assert (weighed.drop("destroyed")["failed_share"] == 0.0).all()


def test_draws_that_fail_are_counted_and_left_out():
    whole = fitted("kv_gm_1", 1)
    soft = np.arange(150) < 30
    draws = {
        name: np.where(soft, 0.01 * values, values) if name[:2] in ("mu", "ze") else values
        for name, values in whole.draws.items()
    }
    (planned,) = plan([record()], {"again": {"like": "step_2kV"}})
    found = outlook(planned, replace(whole, draws=draws))
    assert found.predictive.failed == (30, 150) and found.failure.startswith("30 × ")
    assert np.isfinite(found.predictive.known[0].curves).all()
    sizes = [len(part[0].curves) for part in (found.predictive.known, found.predictive.others)]
    assert sizes == [80, 40]
    assert outlook(planned, whole).predictive.failed == (0, 150)


def test_extrapolation_is_flagged(weighed):
    assert "lies outside" in weighed.loc["more", "extrapolation"]
    assert "longest calibration record" in weighed.loc["long", "extrapolation"]
    assert weighed.loc["again", "extrapolation"] == ""


def test_a_candidate_alone_has_its_parameters_only():
    table = table_of({"long": {"like": "step_2kV", "duration": 20}}, ("kv_gm_2",))
    assert table["probability_right"].isna().all()
    assert table["experiment"].tolist() == ["long", "more"]
    assert table.loc[0, "information_kv_gm_2_nats"] > table.loc[1, "information_kv_gm_2_nats"] > 0


def test_the_same_seed_gives_the_same_table(weighed):
    again = table_of({"long": {"like": "step_2kV", "duration": 20}}).set_index("experiment")
    assert again.loc["long"].equals(weighed.loc["long"])


def test_nobody_in_the_running_gives_a_header():
    table = further_table([], {}, seed)
    assert table.empty and "information_candidate_nats" in table


def comparison(**changes):
    """candidate -> (log evidence, converged, verdict)."""
    rows = {
        "a": (0.0, True, "not chosen: elpd -50.0"),
        "b": (90.0, True, "not resolved by these data against c; the smallest order"),
        "c": (95.0, True, "not resolved by these data: elpd +9"),
        "d": (92.5, True, "not chosen: elpd -0.1"),
        "e": (99.0, False, "not ranked: not converged"),
    } | changes
    columns = ["log_evidence", "converged", "verdict"]
    table = pd.DataFrame.from_dict(rows, orient="index", columns=columns)
    return table.rename_axis("candidate").reset_index().assign(n_parameters=range(3, 3 + len(rows)))


def test_contenders_are_chosen_unresolved_or_as_probable():
    assert contenders(comparison()) == ["b", "c", "d"]
    assert contenders(comparison(d=(91.5, True, "not chosen: elpd -0.1"))) == ["b", "c"]


def test_what_did_not_converge_is_no_contender():
    lost = dict.fromkeys("abcde", (1.0, False, "not ranked: not converged"))
    assert contenders(comparison(**lost)) == []
    only = {"b": (1.0, True, "nothing to compare: the only candidate that converged")}
    assert contenders(comparison(**lost | only)) == ["b"]


def test_longer_holds_the_last_excitation():
    switched_off = replace(record(), excitation=step(2000.0, last=90.0))
    long = altered(switched_off, "long", {"like": "step_2kV", "duration": 3})
    assert long.coordinate[-1] == pytest.approx(1.0 + 3 * 59.0)
    assert long.coordinate.size <= 2 * TIME.size and np.all(np.diff(long.coordinate) > 0)
    np.testing.assert_array_equal(long.coordinate[: TIME.size], TIME)
    assert long.excitation.coordinate[-1] == pytest.approx(long.coordinate[-1])
    assert np.all(np.diff(long.excitation.coordinate) > 0)
    assert np.all(long.excitation.values == 2000.0)
    assert long.samples_averaged.size == long.coordinate.size
    assert np.isnan(long.response).all() and long.role == "validate"


@pytest.mark.parametrize("change", [{"duration": 3}, {"speed": 4}, {"excitation": 1.5}])
def test_what_was_recorded_is_still_a_monitor_s(change):
    recorded = replace(record(), excitation=replace(record().excitation, noisy=True))
    assert altered(recorded, "other", {"like": "step_2kV", **change}).excitation.noisy


def test_faster_compresses_time_at_the_same_sampling():
    averaged = replace(record(), samples_averaged=np.full(TIME.size, 10.0))
    fast = altered(averaged, "fast", {"like": "step_2kV", "speed": 4})
    np.testing.assert_allclose(fast.coordinate, TIME / 4)
    np.testing.assert_allclose(fast.excitation.coordinate, record().excitation.coordinate / 4)
    assert np.all(fast.samples_averaged == 2.5)


def test_excitation_is_scaled_from_rest():
    stretched = replace(
        record(), coordinate_name="stretch", coordinate=np.array([1.0, 1.5, 2.0]),
        excitation=replace(record().excitation, name="stretch", unit="1",
                           coordinate=np.array([1.0, 2.0]), values=np.array([1.0, 2.0])),
    )  # fmt: skip
    found = altered(stretched, "more", {"like": "step_2kV", "excitation": 1.5})
    np.testing.assert_allclose(found.coordinate, [1.0, 1.75, 2.5])
    np.testing.assert_allclose(found.excitation.values, [1.0, 2.5])
    volts = altered(record(), "more", {"like": "step_2kV", "excitation": 1.5}).excitation.values
    assert np.all(volts == 3000.0)


def test_a_gain_and_its_phase_are_one_experiment():
    gain = replace(record("frequency", role="validate"), protocol="frequency_response")
    phase = replace(gain, name="frequency_phase", response_name="phase")
    (held_out, asked) = plan([gain, phase], {"wide": {"like": "frequency", "excitation": 2}})
    assert [each.name for each in held_out.records] == ["frequency", "frequency_phase"]
    assert [each.name for each in asked.records] == ["wide", "wide_phase"]


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"like": "sinne"}, ("new: like 'sinne' is not a record", "did you mean 'sine'")),
        ({"like": "sine", "duration": 2}, ("does not end with a constant", "or give speed")),
        ({"like": "pull", "speed": 2}, ("pull (quasi_static) has no time",)),
    ],
)
def test_what_cannot_be_done_is_one_sentence(entry, words):
    protocols = {"sine": "sine", "pull": "quasi_static", "step": "step"}
    (fault,) = faults({"new": entry}, protocols)
    assert all(word in fault for word in words)
    assert faults({"step": {"like": "step"}}, protocols)[0].startswith("step is a record already")
    with pytest.raises(Faults, match="further_experiments: new: like"):
        plan([record()], {"new": {"like": "sinne"}})
