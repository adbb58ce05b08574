"""A proposal for moves on the unit Gaussian."""

import numpy as np

from deabayes.sampling.mixture import Mixture
from deabayes.sampling.proposal import Part, Proposal


def wide_proposal(dimension):
    """A proposal that is neither centred on the unit Gaussian nor of its width."""
    means = np.stack([np.full(dimension, 0.2), np.full(dimension, -0.3)])
    mixture = Mixture(np.array([0.6, 0.4]), means, np.stack([1.1 * np.eye(dimension)] * 2))
    return Proposal((Part(1.0, mixture),))
