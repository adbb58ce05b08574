"""`cycles`: long periodic records whose period, drift and noise are known by construction."""

from __future__ import annotations

import numpy as np
import pytest
from tests.shared.periodic_records import periodic, record, reduced, said, unbiased

from deabayes.records.columns import RawRecord
from deabayes.records.preparation.cycles import grouped


@pytest.mark.parametrize("frequency", [1.0, 3.0, 7.0, 10.0])
def test_points_stand_on_the_response_at_their_phase(frequency: float) -> None:
    """Flattened by (pi window / points)^2 / 6 = 0.026 %, four times that its second harmonic."""
    experiment = reduced(record(frequency))
    error = experiment.response - periodic(experiment.coordinate, frequency)
    assert np.abs(error).max() < 2.6e-4 + 4.0 * 0.2 * 2.6e-4 + 1e-4
    assert np.all(np.diff(experiment.coordinate) > 0.0)
    middles = experiment.coordinate[5 * 40 :].reshape(5, 40).mean(axis=1) * frequency
    assert middles == pytest.approx([9.5, 18.5, 27.5, 36.5, 45.5], abs=0.01)


@pytest.mark.parametrize("window", [1.0, 0.5, 0.2])
def test_a_mean_flattens_a_sine_by_the_square_of_its_window(window: float) -> None:
    """On a cosine sampled finely enough for a mean to be an integral."""
    time = 1e-4 * np.arange(100_000)
    columns = {
        "time": time,
        "voltage": unbiased(1.0)(time),
        "displacement": np.sin(2 * np.pi * time),
    }
    raw = RawRecord(columns, {"time": "s", "voltage": "V", "displacement": "m"}, "ab" * 32)
    experiment = reduced(raw, window=window, transition=1)
    sine = np.sin(2.0 * np.pi * experiment.coordinate)
    kept = sine @ experiment.response / (sine @ sine)
    assert 1.0 - kept == pytest.approx((np.pi * window / 40) ** 2 / 6.0, rel=0.03)


def test_a_linear_drift_cancels() -> None:
    """It is in the response at the points' times and nowhere else."""
    experiment = reduced(record(2.0, drift=1e-3))
    still = reduced(record(2.0))
    assert np.array_equal(experiment.coordinate, still.coordinate)
    assert experiment.response - still.response == pytest.approx(1e-3 * still.coordinate, abs=1e-12)


def test_equal_phases_of_all_groups_agree() -> None:
    groups = reduced(record(3.0)).response[200:].reshape(5, 40)
    assert np.ptp(groups, axis=0).max() < 5e-4


@pytest.mark.parametrize(("frequency", "drift"), [(3.0, 0.0), (7.0, 2e-3), (10.0, 0.0)])
def test_white_noise_falls_as_samples_averaged_says(frequency: float, drift: float) -> None:
    sigma = 0.01
    clean = reduced(record(frequency, drift=drift))
    scores = []
    for seed in range(20):
        noisy = reduced(record(frequency, drift=drift, noise=sigma, seed=seed), frequency=frequency)
        exact = reduced(record(frequency, drift=drift, seed=seed), frequency=frequency)
        assert np.array_equal(noisy.coordinate, exact.coordinate)
        residual = noisy.response - exact.response
        scores.append(residual * np.sqrt(noisy.samples_averaged) / sigma)
    single, grouped_ones = np.split(np.array(scores), [200], axis=1)
    # relative standard errors of these variances: 2.2 %
    assert np.var(single) == pytest.approx(1.0, abs=0.08)
    assert np.var(grouped_ones) == pytest.approx(1.0, abs=0.08)
    samples = clean.samples_averaged
    assert samples[200:].mean() == pytest.approx(9.0 * samples[:200].mean(), rel=0.1)


def test_samples_on_the_edges_of_windows_are_no_matter_of_rounding() -> None:
    samples = reduced(record(1.0), frequency="1 Hz", points=50).samples_averaged
    assert np.all(samples[:250] == 10.0)
    assert samples[250:] == pytest.approx(90.0)


def test_means_of_means_count_as_such() -> None:
    """A record averaged before has more than one sample behind each of its own."""
    raw = record(1.0)
    before = {"average": {"grid": "uniform", "width": "5 ms"}}
    assert reduced(raw, before).samples_averaged[200:].mean() == pytest.approx(
        reduced(raw).samples_averaged[200:].mean(), rel=0.25
    )


def test_the_excitation_stays_whole() -> None:
    raw = record(2.0, rest=0.5)
    experiment = reduced(raw)
    assert np.array_equal(experiment.excitation.coordinate, raw.columns["time"])
    assert np.array_equal(experiment.excitation.values, raw.columns["voltage"])


def test_rests_and_cut_cycles_are_hidden_and_said() -> None:
    experiment = reduced(record(2.0, rest=3.0, count=50.3, after=20.0))
    entry = said(experiment)
    assert entry["cycles"] == 50
    assert np.allclose(entry["masked"], [[0.0, 2.975], [27.975, 48.149]], atol=0.004)
    assert "50 cycles of 0.5000" in str(entry["effect"])
    assert "5 one by one, 45 averaged in groups of 9, 9, 9, 9, 9" in str(entry["effect"])


def test_transition_is_counted_from_what_is_visible() -> None:
    experiment = reduced(record(2.0), {"crop": {"from": "10 s"}}, transition=0, group=5)
    assert said(experiment)["first_cycle_s"] == pytest.approx(10.0)
    assert said(experiment)["group_sizes"] == [5] * 6
    error = experiment.response - periodic(experiment.coordinate, 2.0)
    assert np.abs(error).max() < 1e-3


def test_bins_masked_in_one_cycle_are_no_points() -> None:
    raw = record(2.0)
    gap = (raw.columns["time"] > 5.0) & (raw.columns["time"] < 5.1)  # a fifth of cycle 10
    columns = {key: values[~gap] for key, values in raw.columns.items()}
    experiment = reduced(RawRecord(columns, raw.units, raw.sha256))
    assert experiment.coordinate.size == 400 - 8
    error = experiment.response - periodic(experiment.coordinate, 2.0)
    assert np.abs(error).max() < 1e-3


@pytest.mark.parametrize(
    ("count", "size", "odd", "sizes"),
    [
        (50, 9, True, [9] * 5),
        (45, 9, True, [9] * 4),  # 4 left over: less than half a group
        (46, 9, True, [9] * 4 + [5]),
        (47, 9, True, [9] * 4 + [5]),  # of 6, one is left out
        (47, 8, False, [8] * 5),
        (49, 8, False, [8] * 5 + [4]),
        (6, 1, True, [1]),
        (5, 9, True, []),
    ],
)
def test_groups(count: int, size: int, odd: bool, sizes: list[int]) -> None:
    groups = grouped(5, count, size, odd)
    assert [g.size for g in groups] == [1] * 5 + sizes
    used = np.concatenate(groups)
    assert np.array_equal(used, np.arange(used.size))


def test_cycles_left_over_are_said() -> None:
    experiment = reduced(record(2.0, count=45))
    assert said(experiment)["group_sizes"] == [1] * 5 + [7] * 5 + [5]
    experiment = reduced(record(2.0, count=45), group=9)
    assert said(experiment)["group_sizes"] == [1] * 5 + [9] * 4
    assert "4 at the end left out" in str(said(experiment)["effect"])
    assert np.allclose(said(experiment)["masked"], [[20.5, 22.499]], atol=2e-3)


@pytest.mark.parametrize(("group", "middle"), [(9, 4), (6, 3)])
def test_decimate_keeps_the_middle_cycle(group: int, middle: int) -> None:
    experiment = reduced(record(2.0, noise=0.01), stable="decimate", group=group)
    every = reduced(record(2.0, noise=0.01), transition=0, group=1)
    cycle = every.response.reshape(-1, 40)[5 + middle]
    assert np.array_equal(experiment.response[200:240], cycle)
    assert np.array_equal(experiment.samples_averaged[200:240], every.samples_averaged[:40])
    assert "thinned to the middle one" in str(said(experiment)["effect"])
