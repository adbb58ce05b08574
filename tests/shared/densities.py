"""Densities of z for tests of climbs."""

import numpy as np

from deabayes.sampling.problem import Split, Target, log_standard_normal


class LeastSquares(Target):
    """The prior N(0, I) times exp(height - sum_k score_k(z)^2 / 2), zero where a score is NaN."""

    def __init__(self, scores, height=0.0):
        self.scores, self.height = scores, height
        super().__init__(lambda z: self.split(z).total)

    def split(self, z):
        scores = self.scores(z)
        return Split(scores, np.zeros_like(scores), np.full(len(z), self.height))


class OfNoPoint(Target):
    """Any density, given whole, of which climbs know no more than its height."""

    def __init__(self, log_density):
        super().__init__(lambda z: log_density(z) - log_standard_normal(z))
