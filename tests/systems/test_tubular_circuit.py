import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.shared.biased_sines import BiasedSine
from tests.shared.tubes import QUANTITIES, actuator

from deabayes.experiment import Excitation, Quantity, Specimen
from deabayes.faults import UserError
from deabayes.integrate.linear import hold
from deabayes.systems.tubular.circuit import Circuit
from deabayes.systems.tubular.system import Tubular
from deabayes.systems.tubular.voigt_kelvin import Chain, MovingChain

WITH_CIRCUIT = {
    **QUANTITIES,
    "series_resistance": Quantity(954.0, "ohm", 250.0, "phase"),
    "leakage_resistance": Quantity(1e9, "ohm"),
    "capacitance": Quantity(180e-9, "F"),
}
SPECIMEN = Specimen("tube", "tubular", {"kind": "simulated"}, WITH_CIRCUIT)
CHAIN = Chain(np.array([1 / 1.5e6]), 1.0 / np.array([[12e6, 6e6]]), np.array([[6e-3, 0.12]]))
SLOW = Circuit(np.array([2e4]), np.array([3e5]), np.array([180e-9]))
KNOTS, VOLTS = np.array([0.0, 0.02, 0.02, 0.05]), np.array([400.0, 1500.0, 300.0, 2000.0])
PIECES = (0.0, 0.02, 400.0, 1500.0), (0.02, 0.05, 300.0, 2000.0), (0.05, 0.2, 2000.0, 2000.0)


def parameters(size=1, **changes):
    values = {"E_0": 1.5e6, "E_1": 12e6, "E_2": 6e6, "tau_1": 6e-3, "tau_2": 0.12}
    values |= {"series_resistance": 954.0} | changes
    return {name: np.full(size, value) for name, value in values.items()}


def integrated(space, time):
    """Output of the first draw by DOP853 of circuit and system, restarted at every kink."""
    size = space.b.shape[1]
    scale = np.append(np.max(np.abs(space.c), axis=0) + 250.0 * (space.c[0] == 0.0), 1e9)

    def slope(t, y, begin, end, first, last):
        amplifier = first + (last - first) * (t - begin) / (end - begin)
        volts = scale[size] * y[size]
        motion = space.a[0] @ (scale[:size] * y[:size]) + space.b[0] * volts**2
        current = (amplifier - volts) / SLOW.series_resistance - volts / SLOW.leakage_resistance
        return np.append(motion, current / SLOW.capacitance) / scale

    state, found = np.zeros(size + 1), np.zeros_like(time)
    for ends in PIECES:
        inside = (time >= ends[0]) & (time < ends[1])
        points = np.append(time[inside], ends[1])
        options = {"rtol": 1e-13, "atol": 1e-18, "max_step": 1e-3}
        y = (
            scale[:, None]
            * solve_ivp(slope, ends[:2], state, "DOP853", points, args=ends, **options).y
        )
        found[inside] = (space.c[0] @ y[:size] + space.d[0] * y[size] ** 2)[:-1]
        state = y[:, -1] / scale
    return found


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("mass", [None, 21.4])
def test_any_command_drives_the_chain_through_the_circuit(mass, even):
    time = np.linspace(0.0, 0.2, 200, endpoint=False)
    if not even:
        time = np.sort(np.random.default_rng(1).uniform(0.0, 0.2, 57))
    moving = CHAIN if mass is None else MovingChain(CHAIN, np.array([mass]))
    found = SLOW.drive(moving.state_space(), hold(KNOTS, VOLTS, time))[0]
    expected = integrated(moving.state_space(), time)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10 * expected.max())


def test_a_sampled_sine_tends_to_the_closed_form():
    """The record is linear between its samples: its error falls with their interval squared."""
    system, time = Tubular("voigt_kelvin_2_inertia_circuit", SPECIMEN), np.linspace(0.0, 0.2, 41)
    sine = BiasedSine(1250.0, 1250.0, 10.0)
    expected = actuator(2, 100).strain(sine, time)[0]

    def error(samples):
        knots = np.linspace(0.0, 0.2, samples + 1)
        excitation = Excitation("voltage", "V", knots, sine(knots), {"load_g": 100})
        strain = system.predict(excitation, time, "strain", parameters())[0]
        return np.abs(strain - expected).max() / expected.max()

    assert error(2000) < 2e-5
    assert error(500) == pytest.approx(16.0 * error(2000), rel=0.05)


def test_a_fast_circuit_is_none():
    """What it delays vanishes with its time constant."""
    space, time = MovingChain(CHAIN, np.array([21.4])).state_space(), np.linspace(0.0, 0.2, 41)
    direct = space.response(hold(KNOTS, VOLTS, time, power=2))

    def distance(resistance):
        fast = Circuit(np.array([resistance]), np.array([1e12]), np.array([180e-9]))
        charged = fast.drive(space, hold(KNOTS, VOLTS, time))
        return np.abs(charged - direct).max() / direct.max()

    assert distance(1.0) == pytest.approx(100.0 * distance(0.01), rel=0.01)
    assert distance(1e-6) < 1e-10


def test_the_resistance_is_a_parameter_of_the_candidate_with_circuit_only():
    names = [p.name for p in Tubular("voigt_kelvin_2_circuit", SPECIMEN).parameters()]
    assert names[-1] == "series_resistance"
    assert len(Tubular("voigt_kelvin_2_inertia", SPECIMEN).parameters()) == len(names) - 1
    step = Excitation("voltage", "V", np.zeros(2), np.array([0.0, 2e3]))
    draws = parameters(3) | {"series_resistance": np.array([954.0, 2e4, -1.0])}
    strain = Tubular("voigt_kelvin_2_circuit", SPECIMEN).predict(
        step, np.array([1e-3, 1.0]), "strain", draws
    )
    assert strain[1, 0] < 0.2 * strain[0, 0]
    assert strain[1, 1] == pytest.approx(strain[0, 1], rel=1e-3)
    assert np.isnan(strain[2]).all()


def test_a_draw_is_computed_alike_in_any_company():
    rng = np.random.default_rng(2)
    draws = {n: v * np.exp(0.2 * rng.standard_normal(11)) for n, v in parameters(11).items()}
    system = Tubular("voigt_kelvin_2_inertia_circuit", SPECIMEN)
    excitation = Excitation("voltage", "V", KNOTS, VOLTS)
    simulate = system.simulator(excitation, np.linspace(0.0, 0.2, 41), "strain")
    together = simulate(draws)
    for w in (0, 7, 10):
        alone = simulate({name: values[[w]] for name, values in draws.items()})
        assert np.array_equal(alone[0], together[w])


def test_mistakes_are_named():
    with pytest.raises(UserError, match="_inertia_circuit"):
        Tubular("voigt_kelvin_2_circuit_inertia", SPECIMEN)
    bare = {n: q for n, q in WITH_CIRCUIT.items() if n != "capacitance"}
    with pytest.raises(UserError, match="lacks capacitance, which a circuit needs"):
        Tubular("voigt_kelvin_2_circuit", Specimen("tube", "tubular", {}, bare))
