"""No usual preparation moves a parameter: records without noise, fitted after it, tell the truth.

The shift of every parameter that the difference of the prepared record and the model makes,
(J^T W J)^-1 J^T W r to first order, is held against its standard deviation under the noise.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from deabayes.experiment import Experiment, FloatArray, Quantity, Specimen
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.records.preparation import prepare
from deabayes.records.preparation.average import gauss
from deabayes.systems import System, build

SLIGHT = 1e-4
UNITS = {"time": "s", "voltage": "V", "displacement": "m", "stretch": "1", "nominal_stress": "Pa"}


def specimen(system: str, **values: tuple[float, str]) -> Specimen:
    quantities = {name: Quantity(*each) for name, each in values.items()}
    return Specimen("s", system, {"kind": "simulated"}, quantities)


TUBE = specimen(
    "tubular", thickness=(80e-6, "m"), relative_permittivity=(3.1, "1"), active_length=(0.05, "m"),
    cross_section=(2.4e-5, "m^2"), total_mass=(3e-3, "kg"), active_mass=(2e-3, "kg"),
    sensor_mass=(4e-3, "kg"),
)  # fmt: skip
FILM = specimen(
    "membrane", thickness=(1e-4, "m"), permittivity=(25e-12, "F/m"), prestretch=(1.3, "1"),
    side_length=(0.04, "m"),
)  # fmt: skip
STRIP = specimen("tensile_strip", cross_section=(1e-5, "m^2"), gauge_length=(0.05, "m"))
FAST_TUBE = {"E_0": 7.148e6, "E_1": 10.72e6, "tau_1": 4e-3}
FAST_FILM = {"mu_alpha": 3e5, "zeta_alpha": 100.0, "J_alpha": 100.0, "mu_beta_1": 1.5e5,
             "tau_beta_1": 0.2, "J_beta": 100.0}  # fmt: skip
SOFT_STRIP = {"mu": 4e4, "mu_beta_1": 3e4, "tau_1": 12.0}


def steps(time: FloatArray, at: float, size: float) -> FloatArray:
    return np.where(time >= at, size, 0.0)


def ramp(time: FloatArray, end: float, size: float) -> FloatArray:
    return 1.0 + size * np.clip(time / end, 0.0, 1.0)


def recorded(
    system: System, time: FloatArray, driven: FloatArray, protocol: str, truth: Mapping[str, float]
) -> tuple[RawRecord, ExperimentRow]:
    """The record that the truth leaves, without noise."""
    excitation, response = (
        ("stretch", "nominal_stress") if system.name == "tensile_strip"
        else ("voltage", "displacement")
    )  # fmt: skip
    row = ExperimentRow("a", protocol, "a.csv", "calibrate", excitation, response, {})
    columns = {"time": time, excitation: driven, response: np.linspace(1.0, 2.0, time.size)}
    units = {name: UNITS[name] for name in columns}
    empty = prepare(row, RawRecord(columns, units, "ab" * 32), system.specimen, [])
    draws = {name: np.array([value]) for name, value in truth.items()}
    columns[response] = system.simulator_of(empty)(draws)[0]
    return RawRecord(columns, units, "ab" * 32), row


def shifts(system: System, experiment: Experiment, truth: Mapping[str, float], noise: float):
    """Of every parameter's logarithm, in standard deviations."""
    names = list(truth)
    factors = np.exp(SLIGHT * np.vstack([np.zeros(len(names)), *_both(len(names))]))
    draws = {name: truth[name] * factors[:, k] for k, name in enumerate(names)}
    found = system.simulator_of(experiment)(draws)
    slopes = (found[1::2] - found[2::2]).T / (2.0 * SLIGHT)
    weights = np.sqrt(experiment.samples_averaged) / noise
    slopes, residual = slopes * weights[:, None], (experiment.response - found[0]) * weights
    covariance = np.linalg.pinv(slopes.T @ slopes, rcond=1e-12)
    return (covariance @ slopes.T @ residual) / np.sqrt(np.diagonal(covariance))


def _both(count: int) -> list[FloatArray]:
    rows = []
    for k in range(count):
        for sign in (1.0, -1.0):
            row = np.zeros(count)
            row[k] = sign
            rows.append(row)
    return rows


def rung(time: FloatArray) -> FloatArray:
    return steps(time, 0.02, 2e3)


RECORDS = {
    # case 17: tau is as long as the first bin
    "a tube's fast creep": (
        TUBE, "voigt_kelvin_1", FAST_TUBE, np.arange(0.0, 0.52, 1e-3), rung, "creep", 1e-7),
    "a fast membrane's step": (
        FILM, "kv_gm_1", FAST_FILM, np.arange(0.0, 1.0, 2e-3),
        lambda time: steps(time, 0.05, 3500.0), "step", 2e-6),
    "a tube that rings": (
        TUBE, "voigt_kelvin_1_inertia", FAST_TUBE, np.arange(0.0, 0.52, 1e-4),
        rung, "creep", 1e-7),
    "a tube that rings long before the end": (
        TUBE, "voigt_kelvin_1_inertia", FAST_TUBE, np.arange(0.0, 5.0, 1e-4),
        rung, "creep", 1e-7),
    "a tube's few cycles": (
        TUBE, "voigt_kelvin_1", FAST_TUBE, np.arange(0.0, 0.5, 1e-3),
        lambda time: 1250.0 * (1.0 - np.cos(20.0 * np.pi * time)), "sine", 1e-7),
    "a tube's many cycles": (
        TUBE, "voigt_kelvin_1", FAST_TUBE, np.arange(0.0, 5.0, 5e-4),
        lambda time: 1250.0 * (1.0 - np.cos(20.0 * np.pi * time)), "sine", 1e-7),
    "a strip's relaxation": (
        STRIP, "neo_hookean_units_1", SOFT_STRIP, np.arange(0.0, 200.0, 0.05),
        lambda time: ramp(time, 2.0, 1.0), "relaxation", 50.0),
    "a strip pulled and let go": (
        STRIP, "neo_hookean_units_1", SOFT_STRIP, np.arange(0.0, 20.0, 0.01),
        lambda time: 1.0 + np.minimum(time, 20.0 - time) / 10.0, "load_unload", 50.0),
}  # fmt: skip


@pytest.mark.parametrize("record", RECORDS)
def test_the_usual_preparation_moves_no_parameter(record: str) -> None:
    known, candidate, truth, time, drive, protocol, noise = RECORDS[record]
    system = build(known.system, candidate, known)
    truth = {p.name: truth[p.name] for p in system.parameters()}
    raw, row = recorded(system, time, drive(time), protocol, truth)
    prepared = prepare(row, raw, known)
    assert prepared.coordinate.size < time.size
    assert np.abs(shifts(system, prepared, truth, noise)).max() < 0.1


@pytest.mark.parametrize(("count", "degree"), [(2, 3), (5, 9)])
def test_nodes_have_the_mean_of_polynomials(count: int, degree: int) -> None:
    rng = np.random.default_rng(1)
    x, weights = rng.uniform(-1e-3, 1e-3, 30), rng.uniform(0.5, 2.0, 30)
    weights /= weights.sum()
    nodes, shares = gauss(x, weights, count)
    for power in range(degree + 1):
        mean = np.sum(weights * x**power)
        assert np.sum(shares * nodes**power) == pytest.approx(
            mean, rel=1e-9, abs=1e-12 * 1e-3**power
        )
    assert np.abs(nodes).max() <= np.abs(x).max()


def test_what_is_averaged_twice_has_the_mean_of_all_samples() -> None:
    time = np.linspace(0.0, 1.0, 400)
    columns = {"time": time, "voltage": np.full(400, 1e3), "displacement": np.exp(-5.0 * time)}
    raw = RawRecord(columns, {name: UNITS[name] for name in columns}, "ab" * 32)
    row = ExperimentRow("a", "creep", "a.csv", "calibrate", "voltage", "displacement", {})
    uniform = [{"average": {"grid": "uniform", "points": n}} for n in (100, 6)]
    experiment = prepare(row, raw, TUBE, [*uniform, {"mask_before": {"time": "0.3 s"}}])
    nodes = experiment.nodes
    assert experiment.coordinate.size == 4 and nodes is not None
    at = experiment.coordinate[nodes.point] + nodes.offsets
    means = np.bincount(nodes.point, nodes.shares * np.exp(-5.0 * at))
    np.testing.assert_allclose(means, experiment.response, rtol=2e-4)  # two nodes a wide bin
