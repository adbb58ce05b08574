"""The amplifier's current: exact against an integrator, closed forms, who computes it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.shared.biased_sines import BiasedSine
from tests.shared.golden import golden_table
from tests.shared.tubes import QUANTITIES, circuit

from deabayes.experiment import Excitation, Quantity, Specimen
from deabayes.faults import UserError
from deabayes.prior.joint import Prior
from deabayes.systems import build
from deabayes.systems.tubular.circuit import Circuit, Supply, time_constant_from_phase
from deabayes.systems.tubular.system import TubularCircuit

CIRCUIT = {
    "series_resistance": Quantity(954.0, "ohm", 250.0),
    "leakage_resistance": Quantity(1e9, "ohm", 2e8),
    "capacitance": Quantity(180e-9, "F", 2e-9),
}
SPECIMEN = Specimen("tube", "tubular", {"kind": "simulated"}, {**QUANTITIES, **CIRCUIT})
SLOW = Circuit(np.array([2e4]), np.array([3e5]), np.array([180e-9]))
"""tau_e = 3.4 ms, a leak of 6 %."""
FAST = Circuit(np.array([954.0]), np.array([1e9]), np.array([180e-9]))
KNOTS = np.array([0.0, 0.02, 0.02, 0.05])
VOLTS = np.array([400.0, 1500.0, 300.0, 2000.0])
PIECES = (0.0, 0.02, 400.0, 1500.0), (0.02, 0.05, 300.0, 2000.0), (0.05, 0.2, 2000.0, 2000.0)


def integrated(one, time):
    """The current by DOP853 on its own equation R_S i' = v' - (i - v_C/R_L)/C, piece by piece.

    R_L = (v - R_S i)'s leak: with v_C = v - R_S i no difference of large voltages is left.
    """
    series, leak, capacitance = (
        float(part[0]) for part in (one.series_resistance, one.leakage_resistance, one.capacitance)
    )
    found, current, before = np.zeros_like(time), 0.0, 0.0
    for begin, end, first, last in PIECES:
        steepness = (last - first) / (end - begin)

        def slope(t, i, begin=begin, first=first, steepness=steepness):
            volts = first + steepness * (t - begin)
            return (steepness - (i - (volts - series * i) / leak) / capacitance) / series

        current += (first - before) / series
        inside = (time >= begin) & (time < end)
        points = np.append(time[inside], end)
        options = {"rtol": 1e-12, "atol": 1e-15, "max_step": 0.2 * float(one.time_constant[0])}
        y = solve_ivp(slope, (begin, end), [current], "DOP853", points, **options).y[0]
        found[inside], current, before = y[:-1], y[-1], last
    return found


@pytest.mark.parametrize("one", [SLOW, FAST])
@pytest.mark.parametrize("even", [True, False])
def test_the_current_is_that_of_an_integrator(one, even):
    time = np.linspace(0.0, 0.2, 400, endpoint=False)
    if not even:
        time = np.sort(np.random.default_rng(1).uniform(0.0, 0.2, 97))
    found = one.supplied(Supply.of(KNOTS, VOLTS, time))[0]
    expected = integrated(one, time)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * np.ptp(expected))


def test_it_is_the_difference_of_the_voltages_over_the_resistance():
    time = np.linspace(0.0, 0.2, 400, endpoint=False)
    charged = SLOW.charge(KNOTS, VOLTS, time)
    volts = np.interp(time, KNOTS[2:], VOLTS[2:])
    volts[time < 0.02] = np.interp(time[time < 0.02], KNOTS[:2], VOLTS[:2])
    found = SLOW.supplied(Supply.of(KNOTS, VOLTS, time))
    np.testing.assert_allclose(found, (volts - charged) / 2e4, rtol=0.0, atol=1e-14)


def test_a_held_voltage_leaks_without_cancellation():
    """2 kV over 1 Gohm is 2 uA, from voltages that differ by a millionth of a percent."""
    time = np.array([0.1, 1.0, 200.0])
    held = Supply.of(np.array([0.0, 200.0]), np.full(2, 2000.0), time)
    np.testing.assert_allclose(FAST.supplied(held)[0], 2000.0 / (1e9 + 954.0), rtol=1e-14)


def test_golden_current_of_a_sine():
    """The record is linear between its samples: its error falls with their interval squared."""
    table, sine = golden_table("tubular_circuit_sine", "circuit"), BiasedSine(1250.0, 1250.0, 10.0)
    late = table["time"] > 2e-3
    expected = table["amplifier_current"][late]

    def error(interval):
        knots = np.append(np.arange(0.0, 0.2, interval), 0.2)
        found = circuit().supplied(Supply.of(knots, sine(knots), table["time"][late]))[0]
        return np.abs(found - expected).max() / np.ptp(expected)

    assert error(1e-5) < 2e-5
    assert error(2e-5) == pytest.approx(4.0 * error(1e-5), rel=0.1)


def test_limits_and_draws_that_fail():
    """Without a leak the current of a slow ramp is C v'; a resistance below zero has none."""
    draws = {
        "series_resistance": np.array([954.0, -1.0, 954.0]),
        "leakage_resistance": np.array([1e15, 1e9, 1e9]),
        "capacitance": np.array([180e-9, 180e-9, 190e-9]),
    }
    ramp = Excitation("voltage", "V", np.array([0.0, 1.0]), np.array([0.0, 1000.0]))
    simulate = build("tubular", "circuit", SPECIMEN).simulator(ramp, np.array([0.5]), "current")
    found = simulate(draws)
    assert found[0, 0] == pytest.approx(180e-9 * 1000.0, rel=1e-9)
    assert np.isnan(found[1]).all()
    alone = simulate({name: values[[2]] for name, values in draws.items()})
    assert np.array_equal(alone[0], found[2])


def test_the_phase_of_the_current_gives_the_series_time_constant():
    """(15), leakage neglected: the angle by which the current leads is arctan(1/(R_S C omega))."""
    impedance = 954.0 + 1.0 / (2j * np.pi * 10.0 * 180e-9)
    phase = np.angle(1.0 / impedance)
    assert time_constant_from_phase(phase, 10.0) == pytest.approx(954.0 * 180e-9, rel=1e-9)


def test_the_circuit_alone_and_the_chain_with_it_agree():
    knots = np.linspace(0.0, 0.1, 500)
    sine = Excitation("voltage", "V", knots, 1e3 * np.sin(60.0 * knots))
    time = np.linspace(0.0, 0.1, 37)
    alone = build("tubular", "circuit", SPECIMEN)
    whole = build("tubular", "voigt_kelvin_2_inertia_circuit", SPECIMEN)
    names = [p.name for p in alone.parameters()]
    assert names == ["series_resistance", "leakage_resistance", "capacitance"]
    assert alone.order == 0
    draws = {name: np.array([q.value, 1.1 * q.value]) for name, q in CIRCUIT.items()}
    chain = {"E_0": 1.5e6, "E_1": 12e6, "E_2": 6e6, "tau_1": 6e-3, "tau_2": 0.12}
    more = draws | {name: np.full(2, value) for name, value in chain.items()}
    current = alone.predict(sine, time, "current", draws)
    np.testing.assert_array_equal(whole.predict(sine, time, "current", more), current)
    derived = alone.derived(draws)
    assert derived["series_time_constant"].values[0] == pytest.approx(954.0 * 180e-9)
    assert derived["electrical_time_constant"].values == pytest.approx(
        whole.derived(more)["electrical_time_constant"].values
    )


def test_the_posterior_of_the_circuit_is_a_prior_with_its_correlations():
    """What `prior_from` takes from a posterior of `circuit`: three names, correlated."""
    rng = np.random.default_rng(3)
    scores = rng.multivariate_normal([0.0, 0.0], [[1.0, -0.8], [-0.8, 1.0]], 4000)
    drawn = np.column_stack([
        1010.0 * np.exp(0.02 * scores[:, 0]),
        1.1e9 * np.exp(0.002 * rng.standard_normal(4000)),
        181e-9 * np.exp(0.001 * scores[:, 1]),
    ])  # fmt: skip
    names = [p.name for p in build("tubular", "circuit", SPECIMEN).parameters()]
    system = build("tubular", "voigt_kelvin_2_inertia_circuit", SPECIMEN)
    prior = Prior.from_parameters(system.parameters()).inherit(names, drawn)
    theta = np.log(prior.sample(rng, 4000))
    columns = [prior.names.index(name) for name in names]
    np.testing.assert_allclose(theta[:, columns].std(axis=0), [0.02, 0.002, 0.001], rtol=0.06)
    np.testing.assert_allclose(
        theta[:, columns].mean(axis=0), np.log([1010.0, 1.1e9, 181e-9]), atol=2e-3
    )
    correlation = np.corrcoef(theta[:, columns].T)
    assert correlation[0, 2] == pytest.approx(-0.8, abs=0.04)
    assert abs(correlation[0, 1]) < 0.06
    other = prior.names.index("E_0")
    assert abs(np.corrcoef(theta[:, other], theta[:, columns[0]])[0, 1]) < 0.06


def test_mistakes_are_named():
    step = Excitation("voltage", "V", np.zeros(2), np.array([0.0, 2e3]))
    time = np.array([0.1])
    with pytest.raises(UserError, match=r"'voigt_kelvin_2' has no circuit.*voigt_kelvin_2_circuit"):
        build("tubular", "voigt_kelvin_2", SPECIMEN).simulator(step, time, "current")
    with pytest.raises(UserError, match="'circuit' computes the response 'current'"):
        build("tubular", "circuit", SPECIMEN).simulator(step, time, "displacement")
    bare = Specimen("tube", "tubular", {}, QUANTITIES)
    with pytest.raises(UserError, match="lacks series_resistance, which a circuit needs"):
        build("tubular", "circuit", bare)
    with pytest.raises(UserError, match="write 'circuit'"):
        TubularCircuit("voigt_kelvin_1", SPECIMEN)
