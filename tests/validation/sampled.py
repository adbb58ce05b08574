"""One posterior sampled as a study does."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.inference.log_posterior import LogPosterior
from deabayes.posteriors.content import convergence_summary
from deabayes.posteriors.problem import problem_of
from deabayes.sampling import engine
from deabayes.study import Sampling
from tests.validation.rows import Row

SETTINGS = Sampling()
"""Settings of a study. Posteriors that fail a gate are kept and marked."""


@dataclass(frozen=True)
class Sampled:
    """The draws of one posterior, with what they cost."""

    target: LogPosterior
    result: engine.Sampled
    cpu_seconds: float

    @property
    def z(self) -> FloatArray:
        """(E, S, d), in the prior's normal coordinate."""
        chain = self.result.chain
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
        summary = convergence_summary(self.result)
        failures = summary["failures"]
        assert isinstance(failures, dict)
        return {
            "converged": int(self.result.convergence.converged),
            "r_hat": f"{summary['r_hat_max']:.5f}",
            "ess_bulk": f"{summary['ess_bulk_min']:.0f}",
            "ess_tail": f"{summary['ess_tail_min']:.0f}",
            "tau": f"{summary['tau']:.1f}",
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
    result = engine.sample(problem_of(target), settings, seed)
    return Sampled(target, result, time.process_time() - began)
