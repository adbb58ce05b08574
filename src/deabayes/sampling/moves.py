"""Moves of all ensembles at once, for the warm-up and for sampling.

Walkers of E ensembles form one array (E W, d), ensemble by ensemble. One call of the likelihood
therefore evaluates the draws of all ensembles. A walker's partners are in its own ensemble. The
number of random numbers that a move takes does not depend on the positions of walkers. With the
same stream, an ensemble that starts elsewhere does not change the draws of the others.

`DESnookerMove` of emcee 3.1.6 is not used, because it does not leave the target invariant. (On a
unit Gaussian it gives 0.70 of the variance in 5 dimensions and 0.61 in 10.) A test uses
`DESnookerMove` as the negative control of the check that every move here passes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from emcee.moves.move import Move
from emcee.state import State
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.sampling.problem import Hop
from deabayes.sampling.proposal import Lines, Proposal

INDEPENDENCE, HOP = 0.4, 0.1
"""Shares of the steps: independence proposals, and each hop. The rest are difference moves."""
JUMP, SHORT = 0.1, 0.45
"""Shares of the difference moves: full steps from walker to walker, and short steps.

Full steps change modes. A tight ridge accepts short steps."""
SHORT_STEP = 0.2


def _accept(
    state: State, model: Any, which: NDArray[np.intp], proposed: FloatArray, factor: FloatArray
) -> NDArray[np.bool_]:
    """Move the walkers `which` to their proposals (M, d) if accepted; return which moved."""
    log_prob, blobs = model.compute_log_prob_fn(proposed)
    chance = np.log(model.random.rand(which.size))
    with np.errstate(invalid="ignore"):
        took = np.asarray(log_prob - state.log_prob[which] + factor > chance)
    moved = which[took]
    state.coords[moved], state.log_prob[moved] = proposed[took], log_prob[took]
    if state.blobs is not None:
        state.blobs[moved] = blobs[took]
    return took


class IndependenceMove(Move):
    """Independence proposals x' from frozen densities g.

    The acceptance probability is min(1, p(x') g(x) / (p(x) g(x'))) (Tierney 1994, Annals of
    Statistics 22, 1701).

    Parameters
    ----------
    frozen : one density for all ensembles, or one for each.
    """

    def __init__(self, *frozen: Proposal) -> None:
        self.frozen = frozen

    def propose(self, model: Any, state: State) -> tuple[State, NDArray[np.bool_]]:
        state = State(state, copy=True)
        parts = np.split(state.coords, len(self.frozen))
        points = [g.sample(model.random, len(z)) for g, z in zip(self.frozen, parts, strict=True)]
        factor = [
            np.subtract(*np.split(g.log_density(np.concatenate([z, x])), 2))
            for g, z, x in zip(self.frozen, parts, points, strict=True)
        ]
        every = np.arange(len(state.coords))
        proposed = np.concatenate(points)
        return state, _accept(state, model, every, proposed, np.concatenate(factor))


class DifferenceMove(Move):
    """Differential evolution along straight lines of a frozen map, in steps of several sizes.

    Half of each ensemble moves by gamma (x_a - x_b), where a and b are in the other half (ter Braak
    2006, Statistics and Computing 16, 239). Gamma is 2.38 / sqrt(2 d), 0.2 or 1.
    """

    def __init__(self, lines: Lines, ensembles: int) -> None:
        self.lines, self.ensembles = lines, ensembles

    def propose(self, model: Any, state: State) -> tuple[State, NDArray[np.bool_]]:
        state = State(state, copy=True)
        accepted = np.zeros(len(state.coords), dtype=bool)
        x, log_jacobian = self.lines.straighten(state.coords)
        x = x.copy()
        first, second = self._halves(len(x) // self.ensembles, model.random)
        for moving, resting in ((first, second), (second, first)):
            which = moving.ravel()
            step = self._steps(x, moving.shape, resting, model.random)
            proposed, factor = self.lines.moved(
                state.coords[which], log_jacobian[which], x[which] + step
            )
            took = _accept(state, model, which, proposed, factor)
            x[which[took]] += step[took]
            accepted[which] = took
        return state, accepted

    def _halves(
        self, walkers: int, random: np.random.RandomState
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the indices of the walkers in both halves, (E, W / 2) each."""
        order = np.argsort(random.rand(self.ensembles, walkers), axis=1)
        order += walkers * np.arange(self.ensembles)[:, None]
        return order[:, : walkers // 2], order[:, walkers // 2 :]

    def _steps(
        self,
        x: FloatArray,
        shape: tuple[int, ...],
        resting: NDArray[np.intp],
        random: np.random.RandomState,
    ) -> FloatArray:
        """Return steps (E M, d) for walkers of the shape (E, M)."""
        count, dimension = resting.shape[1], x.shape[1]
        first = random.randint(count, size=shape)
        second = (first + random.randint(1, count, size=shape)) % count
        rows = np.arange(shape[0])[:, None]
        difference = (x[resting[rows, first]] - x[resting[rows, second]]).reshape(-1, dimension)
        kind = random.rand(len(difference), 1)
        gamma = np.where(kind < SHORT, SHORT_STEP, 2.38 / np.sqrt(2.0 * dimension))
        gamma = np.where(kind > 1.0 - JUMP, 1.0, gamma)
        gamma *= 1.0 + 1e-5 * random.standard_normal(gamma.shape)
        return gamma * difference + 1e-9 * random.standard_normal(difference.shape)


class HopMove(Move):
    """Metropolis-Hastings with the proposals of a hop, for all walkers at once."""

    def __init__(self, hop: Hop) -> None:
        self.hop = hop

    def propose(self, model: Any, state: State) -> tuple[State, NDArray[np.bool_]]:
        state = State(state, copy=True)
        proposed, factor = self.hop(state.coords, model.random)
        return state, _accept(state, model, np.arange(len(proposed)), proposed, factor)


def recipe(
    frozen: Sequence[Proposal], hops: Sequence[Hop], ensembles: int, plain: bool = False
) -> list[tuple[Move, float]]:
    """Return the moves with their shares of the steps.

    Parameters
    ----------
    frozen : one proposal for all ensembles, or one for each. Difference moves use the maps of the
        first proposal, if it has any.
    plain : whether to add difference moves without a map. A map fitted to few draws can be wrong
        in regions that other draws have to reach.
    """
    unbent = ((1.0, Lines(frozen[0].coordinates)),)
    lines = frozen[0].lines or unbent
    if plain and frozen[0].lines:
        lines += unbent
    moves: list[tuple[Move, float]] = [(IndependenceMove(*frozen), INDEPENDENCE)]
    moves += [(HopMove(hop), HOP) for hop in hops]
    rest = 1.0 - INDEPENDENCE - HOP * len(hops)
    total = sum(weight for weight, _ in lines)
    moves += [(DifferenceMove(line, ensembles), rest * weight / total) for weight, line in lines]
    return moves
