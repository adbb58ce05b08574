"""Each move keeps the variance of a Gaussian, and takes partners in its own ensemble only."""

import emcee
import numpy as np
import pytest
from emcee.moves import DESnookerMove
from emcee.state import State
from tests.shared.coordinates import COORDINATES
from tests.statistical.units import chain_prior

from deabayes.sampling.mixture import Mixture
from deabayes.sampling.moves import DifferenceMove, HopMove, IndependenceMove, recipe
from deabayes.sampling.problem import Coordinates
from deabayes.sampling.proposal import Lines, Part, Proposal, fit
from deabayes.sampling.warp import fit_warp
from deabayes.systems.ridges.units import UnitHop

ENSEMBLES, WALKERS = 4, 250
"""Many, as a step of them costs little more than one of few."""
THIN = 10


def factor_of(dimension):
    """Of a covariance with neighbours correlated by 0.6 and widths from 0.6 to 1."""
    distance = np.abs(np.subtract.outer(np.arange(dimension), np.arange(dimension)))
    widths = np.geomspace(0.6, 1.0, dimension)
    return np.linalg.cholesky(0.6**distance * np.outer(widths, widths))


def gaussian(dimension):
    """Draws of a correlated Gaussian, and its log density."""
    factor = factor_of(dimension)
    inverse = np.linalg.inv(factor)

    def draw(n, seed):
        return np.random.default_rng(seed).standard_normal((n, dimension)) @ factor.T

    def log_density(z):
        return -0.5 * np.sum((z @ inverse.T) ** 2, axis=1)

    return draw, log_density, inverse


def sampler_of(moves, dimension, log_density, ensembles=ENSEMBLES):
    shape = ensembles * WALKERS, dimension
    return emcee.EnsembleSampler(*shape, log_density, moves=moves, vectorize=True)


def started(z, seed):
    random = np.random.RandomState(np.random.MT19937(np.random.SeedSequence(seed)))
    return State(z, random_state=random.get_state(), copy=True)


def variance_ratio(moves, dimension, steps, ensembles=ENSEMBLES):
    """Variance over the true one, averaged over principal axes, from a start in the Gaussian."""
    moves = moves if isinstance(moves, list) else [(moves, 1.0)]
    draw, log_density, inverse = gaussian(dimension)
    sampler = sampler_of(moves, dimension, log_density, ensembles)
    start = started(draw(ensembles * WALKERS, 0), 1)
    sampler.run_mcmc(start, steps, thin_by=THIN)
    chain = sampler.get_chain(discard=steps // 10, flat=True)
    return float(((chain @ inverse.T) ** 2).mean())


def wide_proposal(dimension):
    """Neither centred on the Gaussian nor of its width."""
    means = np.stack([np.full(dimension, 0.2), np.full(dimension, -0.3)])
    factors = np.stack([1.1 * factor_of(dimension)] * 2)
    return Proposal((Part(1.0, Mixture(np.array([0.6, 0.4]), means, factors)),))


def curved_lines(dimension):
    """A map fitted to draws of a banana: curved lines on the Gaussian, of uneven width."""
    draws = np.random.default_rng(2).standard_normal((4000, dimension))
    draws[:, 1] = 0.3 * draws[:, 1] + 0.8 * draws[:, 0] ** 2
    draws[:, 2] *= 0.3 * np.exp(0.9 * draws[:, 0])
    return Lines(Coordinates(), fit_warp(draws))


def bent_proposal(dimension):
    """Fitted to half of the Gaussian in coordinates with walls, which it reaches beyond."""
    draws = gaussian(dimension)[0](8000, 3)
    half = draws[draws[:, 0] > -0.5]
    return fit(half, 2, np.random.default_rng(4), coordinates=COORDINATES)


def of_its_own(dimension):
    """One for each ensemble, all different."""
    found = []
    for index in range(ENSEMBLES):
        draws = gaussian(dimension)[0](4000, 10 + index) + 0.1 * index
        found.append(fit(draws, 1, np.random.default_rng(index)))
    return found


def hop_over(dimension):
    """The hop of a prior with as many units as the dimension has room for."""
    return UnitHop.of(chain_prior(dimension // 2, others=dimension % 2))


MOVES = {
    "differences": (lambda d: DifferenceMove(Lines(Coordinates()), ENSEMBLES), 25),
    "differences along curved lines": (lambda d: DifferenceMove(curved_lines(d), ENSEMBLES), 25),
    "differences along lines with walls": (
        lambda d: DifferenceMove(bent_proposal(d).lines[0][1], ENSEMBLES),
        25,
    ),
    "independence": (lambda d: IndependenceMove(wide_proposal(d)), 15),
    "independence with walls": (lambda d: IndependenceMove(bent_proposal(d)), 25),
    "independence, a proposal for each": (lambda d: IndependenceMove(*of_its_own(d)), 15),
    "hops": (
        lambda d: [
            (HopMove(hop_over(d)), 0.5),
            (DifferenceMove(Lines(Coordinates()), ENSEMBLES), 0.5),
        ],
        25,
    ),
    "recipe": (lambda d: recipe([wide_proposal(d)], [hop_over(d)], ENSEMBLES), 25),
    "recipe with walls": (lambda d: recipe([bent_proposal(d)], [], ENSEMBLES), 25),
}


@pytest.mark.parametrize(
    ("name", "dimension"),
    [*((name, 5) for name in MOVES), ("recipe", 10), ("recipe with walls", 10)],
)
def test_a_move_keeps_the_variance_of_a_gaussian(name, dimension):
    build, steps = MOVES[name]
    assert variance_ratio(build(dimension), dimension, steps) == pytest.approx(1.0, abs=0.03)


def test_the_recipe_keeps_the_variance_with_an_odd_number_of_ensembles():
    moves = recipe([bent_proposal(5)], [hop_over(5)], 3)
    assert variance_ratio(moves, 5, 40, 3) == pytest.approx(1.0, abs=0.03)


def test_the_check_sees_that_the_snooker_move_is_wrong():
    assert variance_ratio(DESnookerMove(), 5, 25, ensembles=1) < 0.97


class WithoutJacobian(Lines):
    def moved(self, z, log_jacobian, x):
        proposed, factor = super().moved(z, log_jacobian, x)
        return proposed, np.zeros_like(factor)


class TowardsAPartner(DifferenceMove):
    """Half of the way to another walker: no way back is as likely."""

    def _steps(self, x, shape, resting, random):
        first = random.randint(resting.shape[1], size=shape)
        partners = resting[np.arange(shape[0])[:, None], first].ravel()
        moving = np.setdiff1d(np.arange(len(x)), resting.ravel())
        return 0.5 * (x[partners] - x[moving])


class WrongSign(IndependenceMove):
    def propose(self, model, state):
        class Turned:
            def __init__(self, frozen):
                self.sample, self.log_density = frozen.sample, lambda z: -frozen.log_density(z)

        return IndependenceMove(*map(Turned, self.frozen)).propose(model, state)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: DifferenceMove(WithoutJacobian(Coordinates(), curved_lines(5).warp), ENSEMBLES),
        lambda: TowardsAPartner(Lines(Coordinates()), ENSEMBLES),
        lambda: WrongSign(wide_proposal(5)),
    ],
)
def test_the_check_sees_moves_that_are_wrong(wrong):
    assert variance_ratio(wrong(), 5, 25) != pytest.approx(1.0, abs=0.03)


def draws_of(moves, first, seed=7, steps=30):
    """(S, E, W, d) after the first ensemble started at `first` times where it is."""
    draw, log_density, _ = gaussian(5)
    start = draw(ENSEMBLES * WALKERS, 6)
    start[:WALKERS] *= first
    sampler = sampler_of(moves, 5, log_density)
    sampler.run_mcmc(started(start, seed), steps)
    return sampler.get_chain().reshape(steps, ENSEMBLES, WALKERS, 5)


@pytest.mark.parametrize("crossing", [False, True])
def test_an_ensemble_that_starts_elsewhere_does_not_change_the_others(crossing):
    """One starts elsewhere with the same random stream: the others' draws stay as they are.

    Moves that count all walkers as of one ensemble change them: so the test can fail.
    """
    ensembles = 1 if crossing else ENSEMBLES
    moves = recipe([bent_proposal(5)], [hop_over(5)], ensembles)
    usual, moved = draws_of(moves, 1.0), draws_of(moves, 3.0)
    assert usual[:, 0].tobytes() != moved[:, 0].tobytes()
    same = [usual[:, e].tobytes() == moved[:, e].tobytes() for e in range(1, ENSEMBLES)]
    assert all(same) if not crossing else not any(same)


def test_partners_are_in_the_walkers_own_ensemble():
    """Ensembles a thousand apart: a difference that is not tiny is of two ensembles."""
    move = DifferenceMove(Lines(Coordinates()), ENSEMBLES)
    x = np.random.default_rng(8).standard_normal((ENSEMBLES * 10, 3))
    x += 1000.0 * np.repeat(np.arange(ENSEMBLES), 10)[:, None]
    random = np.random.RandomState(9)
    moving, resting = move._halves(10, random)
    whole = np.sort(np.hstack([moving, resting]), axis=1)
    assert whole.ravel().tolist() == list(range(len(x)))
    assert (whole // 10 == np.arange(ENSEMBLES)[:, None]).all()
    assert np.abs(move._steps(x, moving.shape, resting, random)).max() < 20.0


@pytest.mark.parametrize("hops", [0, 1, 2])
def test_the_recipes_shares_add_up(hops):
    moves = recipe([bent_proposal(5)], [hop_over(5)] * hops, ENSEMBLES)
    shares = {}
    for move, share in moves:
        shares[type(move)] = shares.get(type(move), 0.0) + share
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares[IndependenceMove] == pytest.approx(0.4)
    assert shares.get(HopMove, 0.0) == pytest.approx(0.1 * hops)
