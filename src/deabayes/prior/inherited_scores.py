"""Whether draws that another posterior hands on lie where a prior can tell them apart."""

from __future__ import annotations

import numpy as np

from deabayes.distributions.scores import FloatArray
from deabayes.faults import UserError

LARGEST_SCORE = 30.0
"""Further out, normal probabilities are no longer told apart."""


def check_scores(name: str, scores: FloatArray, prior: str) -> None:
    """Refuse draws of a parameter outside its default prior, or so far out that they are as good
    as outside.

    Parameters
    ----------
    scores : (S,), standard normal where the prior holds, NaN outside it.
    prior : it in words.

    Raises
    ------
    UserError
    """
    outside = int(np.sum(~np.isfinite(scores)))
    far = int(np.sum(np.abs(scores) > LARGEST_SCORE))
    if not outside and not far:
        return
    place = "outside" if outside else f"more than {LARGEST_SCORE:.0f} standard deviations out in"
    raise UserError(
        f"prior_from: {outside or far} of {len(scores)} draws of {name} are {place} its "
        f"prior here ({prior}); widen it under priors:"
    )
