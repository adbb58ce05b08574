"""Evidence by nested sampling, independent of every draw the project's own sampler made."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.special import ndtri

from deabayes.comparison.batched import Batched
from deabayes.experiment import FloatArray
from deabayes.faults import UserError

LIVE, CHAINS, REMAINING = 500, 32, 0.01
"""Live points, chains that move at once, and the log evidence left when nested sampling ends."""


def nested(
    log_likelihood: Callable[[FloatArray], FloatArray],
    dimension: int,
    seed: np.random.SeedSequence,
    live: int = LIVE,
) -> tuple[Any, float]:
    """dynesty's results in z, and the CPU seconds they took.

    Skilling 2006 (10.1214/06-BA127), as done by Speagle 2020 (10.1093/mnras/staa278) with random
    slices. The prior of every coordinate of z is standard normal, so that the prior transform is
    the normal quantile, and the likelihood's integral over it the evidence.

    Parameters
    ----------
    log_likelihood : z (W, d) -> (W,); -inf where it fails.

    Raises
    ------
    UserError : dynesty is not installed.
    """
    try:
        from dynesty import NestedSampler
    except ImportError:
        raise UserError(
            "evidence_check: nested needs the package dynesty; `pip install '.[nested]'`, "
            "or leave the check out"
        ) from None
    began = time.process_time()
    batched = Batched(log_likelihood, max(min(CHAINS, live // 4), 1))
    sampler = NestedSampler(
        batched, ndtri, dimension, nlive=live, sample="rslice",
        rstate=np.random.default_rng(seed), pool=batched, queue_size=batched.size,
        use_pool={"prior_transform": False, "update_bound": False},
    )  # fmt: skip
    sampler.run_nested(dlogz=REMAINING, print_progress=False)
    return sampler.results, time.process_time() - began
