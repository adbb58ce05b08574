"""Effective draws per CPU second on a correlated Gaussian: the recipe against plain moves.

Run with ``OMP_NUM_THREADS=1 python benchmarks/sampler.py``. Every sampler starts from the
same particles and makes the same number of steps; the warm-up and the fit of the proposal
are reported apart. The likelihood costs next to nothing, so the overhead of the moves counts
in full.
"""

from __future__ import annotations

import time

import emcee
import numpy as np

from deabayes.sampling import chains
from deabayes.sampling.moves import DifferentialEvolutionMove, initial_state, recipe
from deabayes.sampling.proposal_fit import fit
from deabayes.sampling.smc import from_prior, log_standard_normal

DIMENSION, WALKERS, STEPS = 16, 128, 4000


def correlated_gaussian(dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and precision factor of a likelihood with widths from 0.003 to 0.7."""
    rng = np.random.default_rng(0)
    basis, _ = np.linalg.qr(rng.standard_normal((dimension, dimension)))
    return 0.3 * rng.standard_normal(dimension), basis / np.geomspace(0.003, 0.7, dimension)


def main() -> None:
    mean, factor = correlated_gaussian(DIMENSION)

    def log_likelihood(z: np.ndarray) -> np.ndarray:
        return -0.5 * (((z - mean) @ factor) ** 2).sum(axis=1)

    def target(z: np.ndarray) -> np.ndarray:
        return log_likelihood(z) + log_standard_normal(z)

    began = time.process_time()
    rng = np.random.default_rng(1)
    particles = from_prior(log_likelihood, DIMENSION, 1024, rng).particles
    proposal = fit(particles, 4, rng)
    print(f"warm-up and proposal: {time.process_time() - began:.2f} CPU s")
    samplers = {
        "recipe": recipe(proposal),
        "differential evolution, 0.8 + 0.2 jumps": [
            (DifferentialEvolutionMove(), 0.8),
            (DifferentialEvolutionMove(gamma0=1.0), 0.2),
        ],
        "the same, emcee's own loop": [
            (emcee.moves.DEMove(), 0.8),
            (emcee.moves.DEMove(gamma0=1.0), 0.2),
        ],
        "stretch": [(emcee.moves.StretchMove(), 1.0)],
    }
    for name, moves in samplers.items():
        sampler = emcee.EnsembleSampler(WALKERS, DIMENSION, target, moves=moves, vectorize=True)
        state = initial_state(
            particles[:WALKERS], target(particles[:WALKERS]), np.random.SeedSequence(2)
        )
        began = time.process_time()
        sampler.run_mcmc(state, STEPS)
        spent = time.process_time() - began
        chain = sampler.get_chain(discard=STEPS // 5)
        size = min(chains.ess_bulk(chain[None, :, :, k]) for k in range(DIMENSION))
        tau = chain.shape[0] * WALKERS / size
        print(
            f"{name:45s} {size / spent:8.0f} effective draws per CPU s, "
            f"tau {tau:6.1f} steps, {1e6 * spent / STEPS / WALKERS:5.1f} us per walker and step"
        )


if __name__ == "__main__":
    main()
