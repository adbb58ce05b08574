"""`cycles`: long periodic records whose period, drift and noise are known by construction."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from deabayes.experiment import Experiment, FloatArray, Specimen
from deabayes.preparation import prepare
from deabayes.preparation.cycles import grouped
from deabayes.reading.raw import ExperimentRow, RawRecord

FILM = Specimen("film", "tubular", {"kind": "simulated"}, {})
MONITOR = 0.3
Signal = Callable[[FloatArray], FloatArray]


def biased(frequency: float) -> Signal:
    """0.5 to 5 kV from the trough: never zero while it is on."""
    return lambda time: 2250.0 * np.sin(2.0 * np.pi * frequency * time - np.pi / 2.0) + 2750.0


def unbiased(frequency: float) -> Signal:
    return lambda time: 2500.0 * np.sin(2.0 * np.pi * frequency * time)


def periodic(time: FloatArray, frequency: float) -> FloatArray:
    """A response of unit amplitude with a second harmonic."""
    angle = 2.0 * np.pi * frequency * time
    return np.sin(angle - 0.7) + 0.2 * np.cos(2.0 * angle)


def record(
    frequency: float = 2.0,
    *,
    count: float = 50.0,
    rest: float = 0.0,
    after: float = 0.0,
    interval: float = 1e-3,
    volts: Signal | None = None,
    monitor: float = MONITOR,
    drift: float = 0.0,
    noise: float = 0.0,
    seed: int = 1,
) -> RawRecord:
    """`count` periods of voltage and response between two rests; `drift` per second."""
    rng = np.random.default_rng(seed)
    time = interval * np.arange(round((rest + count / frequency + after) / interval))
    since = time - rest
    on = (since > -1e-9) & (since < count / frequency)
    voltage = np.where(on, (volts or biased(frequency))(since), 0.0)
    response = np.where(on, periodic(since, frequency), 0.0) + drift * time
    columns = {
        "time": time,
        "voltage": voltage + monitor * rng.standard_normal(time.size),
        "displacement": response + noise * rng.standard_normal(time.size),
    }
    return RawRecord(columns, {"time": "s", "voltage": "V", "displacement": "m"}, "ab" * 32)


def reduced(
    raw: RawRecord, *before: object, stated: object = None, then: str = "", **settings: object
) -> Experiment:
    """The record after the steps `before`, `cycles` with its settings, and `then`."""
    row = ExperimentRow("a", "sine", "a.csv", "calibrate", "voltage", "displacement",
                        {} if stated is None else {"frequency_Hz": stated})  # type: ignore[dict-item]  # fmt: skip
    after = [then] if then else []
    return prepare(row, raw, FILM, [*before, {"cycles": settings}, *after])  # type: ignore[list-item]


def said(experiment: Experiment) -> dict[str, object]:
    return dict(experiment.steps[-1])


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
def test_flattening_is_what_the_documentation_says(window: float) -> None:
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


def settling(tau: float) -> RawRecord:
    raw = record(2.0, noise=0.01)
    time = raw.columns["time"]
    slow = 2.0 * (1.0 - np.exp(-time / tau))
    return RawRecord(raw.columns | {"displacement": raw.columns["displacement"] + slow},
                     raw.units, raw.sha256)  # fmt: skip


def test_a_transition_that_is_not_over_is_a_warning() -> None:
    experiment = reduced(settling(5.0))
    # the first group's cycle means: from the middles of cycles 6 and 14, 2.75 s and 6.75 s
    slow = 2.0 * np.exp(-np.arange(2.75, 7.0, 0.5) / 5.0)
    entry = said(experiment)
    assert entry["drift"] == pytest.approx(np.ptp(slow) / np.ptp(experiment.response), rel=0.05)
    off = slow.mean() - slow[4]
    assert entry["off_middle"] == pytest.approx(off / np.ptp(experiment.response), rel=0.1)
    (warning,) = experiment.warnings
    assert "still settles after 5 cycles; raise `transition`" in warning
    assert f"up to {entry['off_middle']:.2%} of the range off" in warning
    assert not reduced(settling(5.0), stable="decimate").warnings
    assert not reduced(settling(0.5)).warnings


def test_what_cancels_is_no_warning() -> None:
    """A steady drift, of 40 % of the range in a group."""
    experiment = reduced(record(2.0, drift=0.2, noise=0.01))
    assert said(experiment)["drift"] == pytest.approx(0.8 / np.ptp(experiment.response), rel=0.02)
    assert said(experiment)["off_middle"] < 1e-3
    assert not experiment.warnings


@pytest.mark.parametrize("group", [3, 5, 9])
def test_how_far_means_are_off(group: int) -> None:
    """Exact where the response bends as a parabola: c (G^2 - 1) / 12 per cycle squared."""
    raw = record(2.0)
    bent = raw.columns["displacement"] + 1e-3 * raw.columns["time"] ** 2
    experiment = reduced(RawRecord(raw.columns | {"displacement": bent}, raw.units, raw.sha256),
                         group=group)  # fmt: skip
    off = 1e-3 * 0.5**2 * (group**2 - 1) / 12
    assert said(experiment)["off_middle"] * np.ptp(experiment.response) == pytest.approx(
        off, rel=0.1
    )


def test_a_growing_amplitude_is_drift_too() -> None:
    raw = record(2.0)
    time = raw.columns["time"]
    grown = raw.columns["displacement"] * (1.0 + 0.01 * time)
    experiment = reduced(RawRecord(raw.columns | {"displacement": grown}, raw.units, raw.sha256))
    assert said(experiment)["drift"] == pytest.approx(0.04 / np.ptp(grown), rel=0.15)


def test_noise_is_no_drift() -> None:
    for seed in range(5):
        experiment = reduced(record(10.0, noise=0.1, seed=seed))
        assert said(experiment)["drift"] == said(experiment)["off_middle"] == 0.0
        assert not experiment.warnings
