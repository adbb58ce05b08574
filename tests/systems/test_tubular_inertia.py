from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.shared.golden import golden_table, load_golden
from tests.shared.tubes import QUANTITIES, STAND_INS, inertia, moving_chain, transfer

from deabayes.experiment import Excitation, Quantity, Specimen
from deabayes.faults import UserError
from deabayes.integrate.linear import hold, relaxation_response
from deabayes.prior.distributions import LogNormal
from deabayes.systems.tubular.base import moving_quantity
from deabayes.systems.tubular.system import Tubular
from deabayes.systems.tubular.voigt_kelvin import Chain, MovingChain

E, TAU, M = (1.5e6, 12e6, 6e6), (6e-3, 0.12), 21.4


def moving(draws=1, seed=0, spread=0.0):
    scatter = np.exp(spread * np.random.default_rng(seed).standard_normal((6, draws)))
    moduli = np.transpose(np.array(E)[:, None] * scatter[:3])
    times = np.transpose(np.array(TAU)[:, None] * scatter[3:5])
    return MovingChain(Chain(1.0 / moduli[:, 0], 1.0 / moduli[:, 1:], times), M * scatter[5])


def specimen(**changes):
    return Specimen("tube", "tubular", {"kind": "simulated"}, QUANTITIES | changes)


def parameters(size=1, **changes):
    values = {"E_0": E[0], "E_1": E[1], "E_2": E[2], "tau_1": TAU[0], "tau_2": TAU[1]}
    return {name: np.full(size, value) for name, value in (values | changes).items()}


@pytest.mark.parametrize(
    ("units", "load"), [(2, 0), (2, 100), (2, 300), (2, 500), (1, 100), (3, 100)]
)
def test_golden_step_with_mass(units, load):
    table = golden_table("tubular_step_mass", f"K{units}_load_{load}g")
    pressure = load_golden("tubular_step_mass")["inputs"]["sigma0_Pa"]
    step = hold([0.0], [pressure], table["time"])
    strain = moving_chain(units, load).state_space().response(step)[0]
    peak = np.abs(table["strain"]).max()
    np.testing.assert_allclose(strain, table["strain"], rtol=0.0, atol=1e-11 * peak)


def test_stand_ins_are_those_of_the_golden_tables():
    inputs = load_golden("tubular_frf")["inputs"]
    for name, value in STAND_INS.items():
        known = inputs[name]
        assert known == (value if isinstance(value, dict) else pytest.approx(value, rel=1e-14))


@pytest.mark.parametrize("load", [0, 100, 300, 500])
def test_golden_inertial_parameter(load):
    expected = load_golden("tubular_frf")["inputs"]["M_kg_per_m"][f"{load} g"]
    assert inertia(load)[0] == pytest.approx(expected, rel=1e-14)


def paper_coefficients():
    """(3) for K = 2: a_0..2 and b_0..4."""
    (e0, e1, e2), (t1, t2) = E, TAU
    a0 = e0 * (e1 + e2) + e1 * e2
    a1 = e0 * (e1 * t1 + e2 * t2) + e1 * e2 * (t1 + t2)
    a2 = e1 * e2 * t1 * t2
    b0 = e0 * e1 * e2
    return (a0, a1, a2), (b0, b0 * (t1 + t2), M * a0 + b0 * t1 * t2, M * a1, M * a2)


def test_the_papers_differential_equation():
    """(2): sum b_n S^(n) = sum a_k sigma^(k), for a voltage that rises from rest as a ramp."""
    a, b = paper_coefficients()
    rate, time = 4e5, np.linspace(0.0, 0.3, 301)
    scale = 250.0 ** np.arange(4)

    def slope(t, y):
        pressure = rate * np.array([t * t, 2.0 * t, 2.0])
        highest = (np.dot(a, pressure) - np.dot(b[:4], y * scale)) / b[4]
        return np.append(y[1:] * scale[1:], highest) / scale

    # S, S' and S'' vanish with the pressure, and S''' with its slope, because M S'' = sigma - q.
    solution = solve_ivp(slope, (0, 0.3), np.zeros(4), "DOP853", time, rtol=1e-13, atol=1e-18)
    load = hold([0.0, 0.3], [0.0, np.sqrt(rate) * 0.3], time, power=2)
    strain = moving().state_space().response(load)[0]
    peak = np.abs(strain).max()
    np.testing.assert_allclose(strain, solution.y[0], rtol=0.0, atol=1e-10 * peak)


def integrated(pressure, pieces, time):
    """Strain by DOP853, restarted wherever the pressure bends."""
    (e0, e1, e2), (t1, t2) = E, TAU

    def slope(t, y, *ends):
        stress = e0 * (y[0] - y[2] - y[3])
        drive = (pressure(t, *ends) - stress) / (M * 250.0)
        units = (stress / e1 - y[2]) / t1, (stress / e2 - y[3]) / t2
        return [250.0 * y[1], drive, *units]

    state, strain = np.zeros(4), np.zeros_like(time)
    for ends in pieces:
        inside = (time >= ends[0]) & (time < ends[1])
        points = np.append(time[inside], ends[1])
        found = solve_ivp(
            slope, ends[:2], state, "DOP853", points, args=ends, rtol=1e-13, atol=1e-17
        )
        strain[inside], state = found.y[0, :-1], found.y[:, -1]
    return strain


@pytest.mark.parametrize("even", [True, False])
def test_a_history_of_ramps_and_jumps_on_any_grid(even):
    knots, volts = np.array([0.0, 0.1, 0.1, 0.3]), np.array([400.0, 1500.0, 300.0, 2000.0])
    time = np.linspace(0.0, 0.4, 200, endpoint=False)
    if not even:
        time = np.sort(np.random.default_rng(1).uniform(0.0, 0.4, 57))
    strain = moving().state_space().response(hold(knots, volts, time, power=2))[0]

    def pressure(t, begin, end, first, last):
        return (first + (last - first) * (t - begin) / (end - begin)) ** 2

    pieces = (0.0, 0.1, 400.0, 1500.0), (0.1, 0.3, 300.0, 2000.0), (0.3, 0.4, 2000.0, 2000.0)
    expected = integrated(pressure, pieces, time)
    np.testing.assert_allclose(strain, expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())


def test_without_mass_it_creeps():
    """For a pressure that only bends, the mass adds its share of M S'': nothing in the limit."""
    time = np.linspace(0.0, 0.5, 501)
    load = hold([0.0, 0.5], [0.0, 1000.0], time, power=2)
    chain = moving().chain
    creep = relaxation_response(load, chain.instantaneous, chain.compliances, chain.time_constants)[
        0
    ]

    def distance(mass):
        strain = MovingChain(chain, np.array([mass])).state_space().response(load)[0]
        return np.abs(strain - creep).max() / creep.max()

    assert distance(1e-2) == pytest.approx(100.0 * distance(1e-4), rel=0.05)
    assert distance(1e-6) < 1e-10


def test_transfer_functions_agree():
    system = moving(3, spread=0.3)
    rates = np.array([0.0, 2j * np.pi, 600j, 30.0 - 100j, -50.0 + 80j])
    gain = transfer(system.state_space(), rates)
    np.testing.assert_allclose(system.transfer(rates), gain, rtol=1e-12)


def test_resonance_is_the_highest_point():
    system = moving(4, spread=0.2)
    frequency, height = system.resonance()
    around = frequency[:, None] * np.array([0.0, 0.5, 0.999, 1.001, 2.0])
    assert np.all(np.abs(system.transfer(2j * np.pi * around)) < height[:, None])
    heavily_damped = MovingChain(
        Chain(np.array([1e-7]), np.array([[1e-6]]), np.array([[0.01]])), np.array([20.0])
    )
    assert heavily_damped.resonance()[0] == 0.0


def test_the_candidate_adds_the_mass():
    system = Tubular("voigt_kelvin_2_inertia", specimen())
    assert [p.name for p in system.parameters()] == list(parameters())
    assert system.order == 2
    table = golden_table("tubular_step_mass", "K2_load_300g")
    step = Excitation("voltage", "V", np.zeros(2), np.array([0.0, 2e3]), {"load_g": 300})
    strain = system.predict(step, table["time"], "strain", parameters())[0]
    peak = np.abs(table["strain"]).max()
    np.testing.assert_allclose(strain, table["strain"], rtol=0.0, atol=1e-11 * peak)
    displacement = system.predict(step, table["time"], "displacement", parameters())[0]
    np.testing.assert_allclose(displacement, 0.07 * strain, rtol=1e-12, atol=1e-18)
    derived = system.derived(parameters())
    assert derived["inertial_parameter"].values == pytest.approx(9.724166666666669, rel=1e-14)
    assert derived["resonance_frequency"].values == pytest.approx(61.3, rel=0.01)


def test_uncertain_masses_are_parameters_of_the_candidate_with_mass_only():
    uncertain = specimen(sensor_mass=Quantity(0.01, "kg", 0.001, "scales"))
    assert "moving_mass" not in {p.name for p in Tubular("voigt_kelvin_2", uncertain).parameters()}
    system = Tubular("voigt_kelvin_2_inertia", uncertain)
    mass = system.parameters()[-1]
    assert mass.name == "moving_mass"
    moving = 0.0462 + 0.5 * (0.1005 - 0.0462) + 0.01
    assert mass.prior == LogNormal(moving, np.sqrt(np.log1p((0.001 / moving) ** 2)))
    draws = parameters(2) | {"moving_mass": np.array([moving, moving + 0.1])}
    step = Excitation("voltage", "V", np.zeros(2), np.array([0.0, 2e3]))
    loaded = Excitation("voltage", "V", np.zeros(2), np.array([0.0, 2e3]), {"load_g": 100.0})
    time = np.linspace(0.0, 0.2, 21)
    strain = system.predict(step, time, "strain", draws)
    hung = system.predict(loaded, time, "strain", draws)
    np.testing.assert_allclose(strain[1], hung[0], rtol=1e-12, atol=1e-15)


def test_masses_add_up_and_their_sds_in_squares():
    masses = (Quantity(0.1, "kg", 4e-3), Quantity(0.05, "kg"), Quantity(0.01, "kg", 1e-3))
    found = moving_quantity(*masses)
    assert found.value == pytest.approx(0.05 + 0.025 + 0.01)
    assert found.sd == pytest.approx(np.hypot(2e-3, 1e-3))
    assert moving_quantity(*(replace(mass, sd=None) for mass in masses)).sd is None


@pytest.mark.parametrize("load", [-1.0, "100 g", float("nan")])
def test_a_wrong_load_is_named(load):
    step = Excitation("voltage", "V", np.zeros(2), np.array([0.0, 2e3]), {"load_g": load})
    with pytest.raises(UserError, match="load_g must be a mass in g"):
        Tubular("voigt_kelvin_2_inertia", specimen()).simulator(step, np.ones(1), "strain")


def test_a_missing_mass_is_named():
    quantities = {name: q for name, q in QUANTITIES.items() if name != "sensor_mass"}
    bare = Specimen("tube", "tubular", {}, quantities)
    Tubular("voigt_kelvin_2", bare)
    with pytest.raises(UserError, match="lacks sensor_mass, which inertia needs"):
        Tubular("voigt_kelvin_2_inertia", bare)
