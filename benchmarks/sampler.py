"""Effective draws per CPU second on a correlated Gaussian: the recipe against plain moves.

Run with ``OMP_NUM_THREADS=1 python -m benchmarks.sampler``. Every sampler starts from the same
particles and makes the same number of steps; the warm-up and the fit of the proposal are
reported apart. The likelihood costs next to nothing, so the overhead of the moves counts in full.
"""

from __future__ import annotations

import time

import emcee
import numpy as np
from emcee.state import State

from deabayes.sampling import chains
from deabayes.sampling.moves import DifferenceMove, recipe
from deabayes.sampling.peaks import peaks
from deabayes.sampling.problem import Coordinates, Target
from deabayes.sampling.proposal import Lines, fit
from deabayes.sampling.tempering import temper

DIMENSION, ENSEMBLES, WALKERS, STEPS = 16, 4, 32, 4000
PARTICLES = 256


def correlated_gaussian(dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and precision factor of a likelihood with widths from 0.003 to 0.7."""
    rng = np.random.default_rng(0)
    basis, _ = np.linalg.qr(rng.standard_normal((dimension, dimension)))
    return 0.3 * rng.standard_normal(dimension), basis / np.geomspace(0.003, 0.7, dimension)


def main() -> None:
    mean, factor = correlated_gaussian(DIMENSION)
    target = Target(lambda z: -0.5 * (((z - mean) @ factor) ** 2).sum(axis=1))

    began = time.process_time()
    rng = np.random.default_rng(1)
    laplace = peaks(target, DIMENSION, rng)
    start = laplace.sample(rng, ENSEMBLES * PARTICLES).reshape(ENSEMBLES, PARTICLES, DIMENSION)
    particles = temper(
        start,
        laplace.log_density,
        lambda z: target(z) - laplace.log_density(z),
        np.random.SeedSequence(2),
    ).particles
    proposal = fit(particles.reshape(-1, DIMENSION), 8, rng)
    spent = time.process_time() - began
    print(f"warm-up and proposal: {spent:.2f} CPU s, {target.evaluations} evaluations")
    walkers = particles[:, :WALKERS].reshape(-1, DIMENSION)
    random = np.random.RandomState(np.random.MT19937(np.random.SeedSequence(3)))
    samplers = {
        "recipe": recipe((proposal,), (), ENSEMBLES),
        "differences alone": [(DifferenceMove(Lines(Coordinates()), ENSEMBLES), 1.0)],
        "emcee's, 0.8 + 0.2 jumps, all in one": [
            (emcee.moves.DEMove(), 0.8),
            (emcee.moves.DEMove(gamma0=1.0), 0.2),
        ],
        "stretch, all in one": [(emcee.moves.StretchMove(), 1.0)],
    }
    for name, moves in samplers.items():
        sampler = emcee.EnsembleSampler(*walkers.shape, target, moves=moves, vectorize=True)
        state = State(walkers, random_state=random.get_state(), copy=True)
        began = time.process_time()
        sampler.run_mcmc(state, STEPS)
        spent = time.process_time() - began
        chain = sampler.get_chain(discard=STEPS // 5)
        size = min(chains.ess_bulk(chain[None, :, :, k]) for k in range(DIMENSION))
        tau = chain.shape[0] * len(walkers) / size
        print(
            f"{name:45s} {size / spent:8.0f} effective draws per CPU s, "
            f"tau {tau:6.1f} steps, {1e6 * spent / STEPS / len(walkers):5.1f} us per draw"
        )


if __name__ == "__main__":
    main()
