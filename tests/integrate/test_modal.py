"""Modes against the exponentials of matrices, which know no special cases."""

import numpy as np
import pytest
from tests.shared.tubes import moving_chain, transfer

from deabayes.integrate.linear import hold
from deabayes.integrate.modal import LARGEST_RESIDUES, Modes, modal_response
from deabayes.integrate.state_space import StateSpace
from deabayes.systems.tubular.voigt_kelvin import Chain, MovingChain

EVEN, UNEVEN = np.linspace(0.0, 0.4, 401), np.geomspace(1e-4, 0.4, 60)
KNOTS, VOLTS = [0.0, 0.01, 0.2, 0.2, 0.3], [0.0, 2e3, 1.5e3, -1e3, 0.0]


def chains(units, draws=40, spread=0.5):
    """Draws about a tube of 40 Hz, some of them so heavy or lossy that nothing rings."""
    rng = np.random.default_rng(units)
    moduli = 3e6 * np.exp(spread * rng.standard_normal((draws, units + 1)))
    times = np.geomspace(5e-3, 0.5, units) * np.exp(spread * rng.standard_normal((draws, units)))
    mass = 10.0 * np.exp(4.0 * spread * rng.standard_normal(draws))
    return MovingChain(Chain(1.0 / moduli[:, 0], 1.0 / moduli[:, 1:], times), mass)


def oscillator(damping):
    """z'' + 2 damping omega z' + omega^2 z = w: poles coincide where damping is 1."""
    omega, damping = 300.0, np.atleast_1d(np.asarray(damping, dtype=float))
    a, b, c = (
        np.zeros((damping.size, 2, 2)),
        np.zeros((damping.size, 2)),
        np.zeros((damping.size, 2)),
    )
    a[:, 0, 1], a[:, 1, 0], a[:, 1, 1] = 1.0, -(omega**2), -2.0 * damping * omega
    b[:, 1], c[:, 0] = 1.0, 1.0
    return StateSpace(a, b, c, np.zeros(damping.size))


def assert_close(found, wanted, tolerance):
    """Relative to each draw's range."""
    scale = np.ptp(wanted, axis=1)[:, None]
    np.testing.assert_allclose(found / scale, wanted / scale, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("time", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("units", [1, 2, 4])
def test_a_moving_chain_as_by_its_matrices(units, time):
    space = chains(units).state_space()
    load = hold(KNOTS, VOLTS, time, power=2)
    assert_close(modal_response(space, load), space.response(load), 1e-11)


@pytest.mark.parametrize("time", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("units", [1, 2, 4])
def test_behind_a_circuit_as_by_its_matrices(units, time):
    space = chains(units).state_space()
    gain, decay = np.linspace(0.2, 1.0, 40), np.geomspace(100.0, 1e5, 40)
    voltage = hold(KNOTS, VOLTS, time)
    found = modal_response(space, voltage, gain, decay)
    assert_close(found, space.response(voltage, gain, decay), 1e-11)


def test_without_mass_the_input_goes_through_at_once():
    chain = chains(3).chain
    load, voltage = hold(KNOTS, VOLTS, UNEVEN, power=2), hold(KNOTS, VOLTS, UNEVEN)
    space, gain, decay = chain.state_space(), np.full(40, 0.9), np.full(40, 300.0)
    assert_close(modal_response(space, load), space.response(load), 1e-12)
    found = modal_response(space, voltage, gain, decay)
    assert_close(found, space.response(voltage, gain, decay), 1e-12)


def test_modes_are_what_the_transfer_function_is_made_of():
    space = chains(3).state_space()
    modes, rate = Modes.of(space), 2j * np.pi * np.array([0.0, 1.0, 40.0, 300.0])
    pairs = modes.residues[:, :, None] / (rate - modes.rates[:, :, None])
    conjugate = modes.residues.conj()[:, :, None] / (rate - modes.rates.conj()[:, :, None])
    np.testing.assert_allclose(
        0.5 * (pairs + conjugate).sum(axis=1), transfer(space, rate), rtol=1e-9
    )


def test_a_circuit_as_fast_as_a_mode_is_no_singularity():
    space = moving_chain(2, 100).state_space()
    rates = Modes.of(space).rates[0]
    slow = -rates.real[rates.imag == 0.0]
    near = np.concatenate([slow, slow / 2.0, slow * (1.0 + 1e-9), slow * 1.01])
    many = StateSpace(
        *(np.repeat(part, near.size, axis=0) for part in (space.a, space.b, space.c, space.d))
    )
    voltage = hold(KNOTS, VOLTS, UNEVEN)
    found = modal_response(many, voltage, np.ones(near.size), near)
    assert_close(found, many.response(voltage, np.ones(near.size), near), 1e-11)


def test_modes_that_coincide_or_nearly_do():
    damping = 1.0 + np.concatenate(
        [[0.0], np.geomspace(1e-15, 1e-2, 40), -np.geomspace(1e-15, 1e-2, 40)]
    )
    space, load = oscillator(damping), hold([0.0, 0.001], [0.0, 1.0], EVEN, power=2)
    apart = Modes.of(space).apart
    assert apart.any() and not apart[0] and not apart.all()
    assert_close(modal_response(space, load), space.response(load), 1e-9)
    voltage, gain, decay = hold(KNOTS, VOLTS, EVEN), np.ones(81), np.full(81, 500.0)
    wanted = space.response(voltage, gain, decay)
    assert_close(modal_response(space, voltage, gain, decay), wanted, 1e-9)


def test_what_is_called_apart_may_be_summed():
    """At the limit rounding costs its square, 1e-10 of the range."""
    load = hold([0.0, 0.001], [0.0, 1.0], EVEN, power=2)
    space = oscillator(1.0 + np.geomspace(1e-14, 1e-2, 200))
    modes, wanted = Modes.of(space), space.response(load)
    static = np.abs(modes.residues / modes.rates).sum(axis=1) * 300.0**2
    assert np.array_equal(modes.apart, static <= LARGEST_RESIDUES)
    assert static[0] > 1e3 * LARGEST_RESIDUES
    assert_close(modal_response(space, load)[modes.apart], wanted[modes.apart], 1e-10)


def test_equal_units_are_one():
    moduli, times = np.array([[3e6, 6e6, 6e6]]), np.array([[0.02, 0.02]])
    twice = MovingChain(Chain(1.0 / moduli[:, 0], 1.0 / moduli[:, 1:], times), np.array([10.0]))
    once = MovingChain(
        Chain(1.0 / moduli[:, 0], 2.0 / moduli[:, 1:2], times[:, :1]), np.array([10.0])
    )
    load = hold(KNOTS, VOLTS, EVEN, power=2)
    wanted = once.state_space().response(load)
    assert_close(modal_response(twice.state_space(), load), wanted, 1e-11)


@pytest.mark.parametrize("behind", [False, True])
def test_a_draw_that_fails_changes_no_other(behind):
    space, load = chains(2).state_space(), hold(KNOTS, VOLTS, UNEVEN, power=1 if behind else 2)
    circuit = (np.ones(40), np.full(40, 1e3)) if behind else ()
    wanted = modal_response(space, load, *circuit)
    a = space.a.copy()
    a[3], a[7, 0, 0], a[11] = np.nan, np.inf, 1e300
    found = modal_response(StateSpace(a, space.b, space.c, space.d), load, *circuit)
    failed = np.isin(np.arange(40), [3, 7, 11])
    assert np.isnan(found[[3, 7]]).all()
    assert not np.isfinite(found[11]).all()
    assert np.array_equal(found[~failed], wanted[~failed])


@pytest.mark.parametrize("bad", [0.0, -50.0])
def test_a_circuit_without_decay_fails(bad):
    space, voltage = chains(1).state_space(), hold(KNOTS, VOLTS, UNEVEN)
    decay = np.where(np.arange(40) == 5, bad, 1e3)
    found = modal_response(space, voltage, np.ones(40), decay)
    assert np.isnan(found[5]).all() and np.isfinite(np.delete(found, 5, axis=0)).all()


@pytest.mark.parametrize("size", [1, 31, 32, 33])
def test_a_draw_is_the_same_in_any_company(size):
    space, load = chains(2).state_space(), hold(KNOTS, VOLTS, UNEVEN, power=2)
    some = StateSpace(space.a[:size], space.b[:size], space.c[:size], space.d[:size])
    for respond in (modal_response, StateSpace.response):
        assert np.array_equal(respond(some, load), respond(space, load)[:size])


def test_a_fast_circuit_in_a_long_step_does_not_overflow():
    space = moving_chain(1, 0).state_space()
    voltage, ones = hold([0.0, 100.0], [1e3, 1e3], np.array([100.0])), np.ones(1)
    found = modal_response(space, voltage, ones, 1e6 * ones)
    assert found[0, 0] == pytest.approx(
        1e6 * transfer(space, np.zeros(1, complex))[0, 0].real, rel=1e-9
    )
