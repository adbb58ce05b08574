"""One posterior sampled as a study does, at the smallest size that the gates still accept."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from deabayes.sampling.first_pass import run_ensemble
from deabayes.sampling.guide import Guide
from deabayes.sampling.pooling import PooledResult, pool

from deabayes.experiment import FloatArray
from deabayes.posterior import LogPosterior
from deabayes.posteriors.content import convergence_summary
from deabayes.posteriors.summary import quantities
from deabayes.study import Sampling
from tests.validation.rows import Row

SETTINGS = Sampling(ensembles=2, walkers=64, particles=512, max_steps=12000)
"""Two ensembles are the fewest that R-hat can compare; the gates are those of a study, the budget
of steps is not: what fails a gate for want of steps is kept and marked."""


@dataclass(frozen=True)
class Sampled:
    """The draws of one posterior, with what they cost."""

    target: LogPosterior
    pooled: PooledResult
    cpu_seconds: float

    @property
    def z(self) -> FloatArray:
        """(E, S, d), in the prior's normal coordinate."""
        chain = self.pooled.chain
        return chain.reshape(len(chain), -1, chain.shape[3])

    @property
    def theta(self) -> FloatArray:
        """All draws (S, d), SI."""
        return self.target.prior.to_parameters(self.z.reshape(-1, self.target.dimension))

    def thinned(self, size: int) -> FloatArray:
        """`size` draws (size, d), SI, spread evenly over all ensembles."""
        flat = self.z.reshape(-1, self.target.dimension)
        picked = np.linspace(0, len(flat) - 1, min(size, len(flat))).astype(int)
        return self.target.prior.to_parameters(flat[picked])

    def row(self) -> Row:
        """How the sampling went."""
        summary = convergence_summary(self.pooled)
        failures = summary["failures"]
        assert isinstance(failures, dict)
        return {
            "converged": int(self.pooled.convergence.converged),
            "r_hat": f"{summary['r_hat_max']:.5f}",
            "ess_bulk": f"{summary['ess_bulk_min']:.0f}",
            "ess_tail": f"{summary['ess_tail_min']:.0f}",
            "tau": f"{summary['tau_max']:.1f}",
            "steps": summary["steps"],
            "evaluations": failures["evaluations"],
            "failed": failures["failed"],
            "cpu_seconds": f"{self.cpu_seconds:.2f}",
        }


def sample(
    target: LogPosterior, seed: np.random.SeedSequence, settings: Sampling = SETTINGS
) -> Sampled:
    """Sample a posterior until every parameter and derived quantity passes the gates."""
    began = time.process_time()
    *streams, pooling = seed.spawn(settings.ensembles + 1)
    likelihood, guide = target.log_likelihood_of_normal, Guide.of(target)
    rough = target.rough().log_likelihood_of_normal
    ensembles = [
        run_ensemble(likelihood, target.dimension, settings, stream, guide=guide, rough=rough)
        for stream in streams
    ]
    pooled = pool(
        likelihood,
        ensembles,
        settings,
        pooling,
        quantities=lambda z: quantities(target, target.prior.to_parameters(z)),
        guide=guide,
    )
    return Sampled(target, pooled, time.process_time() - began)
