"""What an experiment would tell before it is done: which candidate is right, and its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prediction.outcomes import Predictive, Readings


@dataclass(frozen=True)
class CandidateInformation:
    """What y tells about which candidate is right, with Monte Carlo standard errors.

    Attributes
    ----------
    nats : lower bound of the mutual information of M and y, all candidates equally probable;
        at most the logarithm of their number.
    probability_right : of naming the right candidate from y.
    """

    nats: float
    nats_error: float
    probability_right: float
    probability_right_error: float


def candidate_information(
    predictives: Sequence[Predictive], rng: np.random.Generator
) -> CandidateInformation:
    r"""Mutual information of the candidate and an experiment's outcome.

    I(M; y) >= log K + E[log q(M | y)],  q(M | y) = q(y | M) / sum_j q(y | M_j),

    for any q (Barber & Agakov 2003, Advances in Neural Information Processing Systems 16; for
    experiments Foster et al. 2019, arXiv:1903.05480), with y drawn from the candidates' own
    predictives and q their `Predictive`, made from other draws. What q gets wrong loses
    information and never adds any; naming the candidate of the largest q(M | y) likewise is
    at most as often right as by p. No response is an outcome too.
    """
    count = len(predictives)
    terms = [_of_truth(predictives, truth, rng) for truth in range(count)]
    nats, right = (np.array([term[k] for term in terms]) for k in (0, 1))
    errors = np.sqrt(np.sum(np.array([term[2] for term in terms]) ** 2, axis=0)) / count
    return CandidateInformation(
        float(np.log(count) + nats.mean()), float(errors[0]), float(right.mean()), float(errors[1])
    )


def _of_truth(
    predictives: Sequence[Predictive], truth: int, rng: np.random.Generator
) -> tuple[float, float, tuple[float, float]]:
    """Means of log q(M | y) and of being right where one candidate is, with their errors."""
    share = predictives[truth].failed_share
    nats, right = _judged(np.array([[each.log_failed[0]] for each in predictives]), truth)
    if share == 1.0:
        return float(nats[0]), float(right[0]), (0.0, 0.0)
    y = predictives[truth].sample(rng)
    log_q = [_log_response(each, y) for each in predictives]
    seen_nats, seen_right = _judged(np.stack(log_q), truth)
    kept = (1.0 - share) / np.sqrt(len(seen_nats))
    return (
        share * float(nats[0]) + (1.0 - share) * float(seen_nats.mean()),
        share * float(right[0]) + (1.0 - share) * float(seen_right.mean()),
        (kept * float(seen_nats.std()), kept * float(seen_right.std())),
    )


def _log_response(predictive: Predictive, y: Readings) -> FloatArray:
    """log q of outcomes; only a failure is expected where no draw has a response."""
    if not predictive.known:
        return np.full(len(y[0]), -np.inf)
    return predictive.log_failed[1] + predictive.log_density(y)


def _judged(log_q: FloatArray, truth: int) -> tuple[FloatArray, FloatArray]:
    """log q(M | y) of the truth and the share of right answers, for log q(y | M) (K, Y).

    Where candidates are equally probable, one of them is picked at random.
    """
    from scipy.special import logsumexp

    best = log_q >= log_q.max(axis=0) - 1e-12
    right = np.where(best[truth], 1.0 / best.sum(axis=0), 0.0)
    return np.asarray(log_q[truth] - logsumexp(log_q, axis=0)), right


def parameter_information(predictive: Predictive) -> tuple[float, float]:
    r"""Expected information about a candidate's parameters in nats, and its standard error.

    (1 - f) E[1/2 log det(I + C^(-1/2) F F^T C^(-1/2))] - f log f - (1 - f) log(1 - f), with f the
    share of draws without a response, which tell that much, and E over draws of the noise C
    (Lindley 1956, 10.1214/aoms/1177728069, for a linear model with normal noise; Chaloner &
    Verdinelli 1995, 10.1214/ss/1177009939). Exact for curves linear in the parameters; of all
    laws with the curves' covariance the normal one gives most. Information about the
    noise is left out.
    """
    from scipy.special import entr

    failed = predictive.failed_share
    values = (1.0 - failed) * np.array([each.information for each in predictive.normals])
    failing = float(entr(failed) + entr(1.0 - failed))
    return float(values.mean()) + failing, float(values.std() / np.sqrt(values.size))
