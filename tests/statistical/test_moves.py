"""Canaries of the moves: each leaves a Gaussian as wide as it is, and wrong ones are seen."""

from dataclasses import replace

import emcee
import numpy as np
import pytest
from emcee.moves import DESnookerMove
from tests.statistical.proposals import wide_proposal
from tests.unit.coordinates import COORDINATES

from deabayes.distributions import LogNormal, LogUniform
from deabayes.parameter import Parameter
from deabayes.prior.joint import Prior
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.guide import NO_GUIDE
from deabayes.sampling.moves import (
    CrossedMove,
    DifferentialEvolutionMove,
    HopMove,
    IndependenceMove,
    StraightenedMove,
    build_sampler,
    initial_state,
    last_accepted,
    recipe,
)
from deabayes.sampling.proposal import Lines
from deabayes.sampling.proposal_fit import MOST_TRIES, fit
from deabayes.sampling.smc import log_standard_normal
from deabayes.sampling.unit_hop import UnitHop
from deabayes.sampling.warp import fit_warp

WALKERS = 400
"""Many, as a step of them costs little more than one of few."""


def variance_ratio(move, dimension, steps):
    """Variance over the true one, averaged over coordinates, on a unit Gaussian."""
    moves = move if isinstance(move, list) else [(move, 1.0)]
    sampler = emcee.EnsembleSampler(
        WALKERS, dimension, log_standard_normal, moves=moves, vectorize=True
    )
    start = np.random.default_rng(0).standard_normal((WALKERS, dimension))
    state = initial_state(start, log_standard_normal(start), np.random.SeedSequence(1))
    sampler.run_mcmc(state, steps, thin_by=10)
    chain = sampler.get_chain(discard=steps // 10, flat=True)
    return float((chain**2).mean())


def curved_lines(dimension):
    """A map fitted to draws of a banana: curved lines on the unit Gaussian, of uneven width."""
    draws = np.random.default_rng(2).standard_normal((4000, dimension))
    draws[:, 1] = 0.3 * draws[:, 1] + 0.5 * draws[:, 0] ** 2
    draws[:, 2] *= 0.3 * np.exp(0.7 * draws[:, 0])
    return Lines(Coordinates(), fit_warp(draws))


def bent_proposal(dimension, fine=False):
    """Fitted to half of the unit Gaussian in coordinates with walls, which it reaches beyond."""
    draws = np.random.default_rng(3).standard_normal((8000, dimension))
    half = draws[draws[:, 0] > -0.5]
    return fit(half, 2, np.random.default_rng(4), fine=fine, coordinates=COORDINATES)


def along_bent_lines(dimension):
    """Moves along the lines of its map, some of which lead out of the support."""
    return StraightenedMove(bent_proposal(dimension).lines[0][1])


def hop_over(dimension):
    """The hop of a prior with as many units as the dimension has room for."""
    units = dimension // 2
    moduli = [
        Parameter(f"E_{i}", "E", "Pa", "", LogNormal(1e6, 0.8), "", belongs_to=f"tau_{i}")
        for i in range(1, units + 1)
    ]
    times = [
        Parameter(f"tau_{i}", "tau", "s", "", LogUniform(0.01, 10.0), "", ordered="tau")
        for i in range(1, units + 1)
    ]
    others = [
        Parameter(f"x_{i}", "x", "1", "", LogNormal(1.0, 1.0), "") for i in range(dimension % 2)
    ]
    return UnitHop.of(Prior.from_parameters([*moduli, *times, *others]))


MOVES = {
    "hops": (
        lambda d: [(HopMove(hop_over(d)), 0.5), (DifferentialEvolutionMove(), 0.5)],
        125,
    ),
    "along straightened ridges": (lambda d: StraightenedMove(curved_lines(d)), 125),
    "some straightened coordinates": (
        lambda d: [
            (CrossedMove(curved_lines(d), 0.0), 0.5),
            (CrossedMove(curved_lines(d), 0.3), 0.5),
        ],
        125,
    ),
    "independence": (lambda d: IndependenceMove(wide_proposal(d)), 75),
    "several in a row": (lambda d: IndependenceMove(replace(wide_proposal(d), tries=5)), 25),
    "along lines of other coordinates": (along_bent_lines, 125),
    "independence in other coordinates": (lambda d: IndependenceMove(bent_proposal(d)), 125),
    "recipe in other coordinates": (lambda d: recipe(bent_proposal(d, fine=True)), 125),
    "differential evolution": (lambda d: DifferentialEvolutionMove(), 125),
    "recipe": (lambda d: recipe(wide_proposal(d)), 125),
    "recipe where proposals are rarely accepted": (
        lambda d: recipe(bent_proposal(d, fine=True), rare=True),
        125,
    ),
    "jumps in the recipe": (
        lambda d: [
            (DifferentialEvolutionMove(gamma0=1.0), 0.5),
            (DifferentialEvolutionMove(), 0.5),
        ],
        125,
    ),
}


@pytest.mark.parametrize("dimension", [5, 10])
@pytest.mark.parametrize("name", MOVES)
def test_move_keeps_the_variance_of_a_gaussian(name, dimension):
    build, steps = MOVES[name]
    assert variance_ratio(build(dimension), dimension, steps) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("dimension", [5, 10])
def test_the_canary_sees_that_the_snooker_move_is_wrong(dimension):
    assert variance_ratio(DESnookerMove(), dimension, 50) < 0.97


def test_a_wrong_sign_of_the_factor_would_be_seen():
    class Wrong(IndependenceMove):
        def _log_weights(self, state, points, log_target):
            here, there = super()._log_weights(state, points, log_target)
            return 2 * state.log_prob - here, 2 * log_target - there

    assert variance_ratio(Wrong(wide_proposal(5)), 5, 50) != pytest.approx(1.0, abs=0.03)


def test_the_last_of_several_accepted_in_a_row_counts():
    here, there = np.zeros(3), np.array([[1.0, -9.0, 2.0], [-3.0, -9.0, 5.0], [0.5, -9.0, -1.0]])
    chance = np.array([[-0.1, -0.1, -0.1], [-5.0, -0.1, -0.1], [-0.1, -0.1, -0.1]])
    assert last_accepted(here, there, chance).tolist() == [2, -1, 1]
    chance[2, 0] = 4.0  # 0.5 against the -3 that it is at: refused only above 3.5
    assert last_accepted(here, there, chance).tolist() == [1, -1, 1]


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_crossover_changes_as_many_straightened_coordinates_as_it_says(share):
    lines, walkers = curved_lines(8), np.random.default_rng(5).standard_normal((400, 8))
    move = CrossedMove(lines, share)
    proposed, _ = move.get_proposal(walkers[:200], [walkers[200:]], np.random.RandomState(6))
    steps = lines.straighten(proposed)[0] - lines.straighten(walkers[:200])[0]
    changed = (np.abs(steps) > 1e-9).sum(axis=1)
    assert changed.min() >= 1
    assert changed.mean() == pytest.approx(1 + 7 * share, abs=0.3)


@pytest.mark.parametrize(
    ("tries", "several", "crossed"),
    [(MOST_TRIES, False, True), (MOST_TRIES, True, False), (MOST_TRIES - 1, False, False)],
)
def test_steps_of_few_coordinates_are_made_where_the_proposals_are_rarely_accepted(
    tries, several, crossed
):
    frozen = replace(bent_proposal(5, fine=True), tries=tries)
    guide = replace(NO_GUIDE, several=several)
    sampler = build_sampler(log_standard_normal, frozen, (20, 5), guide)
    assert any(isinstance(move, CrossedMove) for move in sampler._moves) == crossed


def test_straightened_moves_without_their_jacobian_would_be_seen():
    class Wrong(StraightenedMove):
        def get_proposal(self, s, c, random):
            proposed, factors = super().get_proposal(s, c, random)
            return proposed, np.zeros_like(factors)

    assert variance_ratio(Wrong(curved_lines(5)), 5, 125) != pytest.approx(1.0, abs=0.03)
