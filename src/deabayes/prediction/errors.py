"""Errors of predictions, and checks whether bands cover as many observations as they should."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from deabayes.experiment import Experiment, FloatArray
from deabayes.prediction.bands import LEVELS, Samples

if TYPE_CHECKING:
    import pandas as pd


def relative_maximum_error(observed: ArrayLike, predicted: ArrayLike) -> FloatArray:
    """e_m = max|y - f| / (max y - min y), one value per predicted curve.

    Parameters
    ----------
    observed : y (N,).
    predicted : f (..., N), any leading axes, e.g. draws (W, N).

    Returns
    -------
    ndarray
        (...), a fraction of the observed range; NaN where a curve is not finite.

    Raises
    ------
    ValueError
        If the lengths differ, or the observations do not vary or are not finite.
    """
    observed, predicted = _curves(observed, predicted)
    return np.max(np.abs(observed - predicted), axis=-1) / np.ptp(observed)


def relative_rms_error(observed: ArrayLike, predicted: ArrayLike) -> FloatArray:
    """e_rms = sqrt(mean (y - f)^2) / (max y - min y), one value per predicted curve.

    Shapes and exceptions are those of `relative_maximum_error`.
    """
    observed, predicted = _curves(observed, predicted)
    return np.sqrt(np.mean((observed - predicted) ** 2, axis=-1)) / np.ptp(observed)


def crps(observed: ArrayLike, samples: ArrayLike) -> FloatArray:
    """Continuous ranked probability score of S samples at each point, in the response's unit.

    The fair estimate is unbiased for every S (Ferro 2014, Q. J. R. Meteorol. Soc. 140:1917):
    CRPS = mean_i |x_i - y| - 1 / (2 S (S - 1)) sum_ij |x_i - x_j|. The double sum is computed
    from the order statistics, O(S log S). The estimate may be slightly negative.

    Parameters
    ----------
    observed : y (N,).
    samples : x (S, N), S >= 2.

    Returns
    -------
    ndarray
        (N,); smaller is better.
    """
    observed, samples = _same_length(observed, samples)
    if samples.ndim != 2 or len(samples) < 2:
        raise ValueError(f"crps needs at least 2 samples (S, N), got shape {samples.shape}")
    size = len(samples)
    ordered = np.sort(samples - observed, axis=0)
    rank_weights = 2.0 * np.arange(1, size + 1) - size - 1.0
    spread = rank_weights @ ordered / (size * (size - 1.0))
    return np.mean(np.abs(ordered), axis=0) - spread


def interval_coverage(observed: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> float:
    """Share of the observations (N,) inside the intervals from `lower` to `upper` (N,)."""
    observed, lower = _same_length(observed, lower)
    observed, upper = _same_length(observed, upper)
    return float(np.mean((lower <= observed) & (observed <= upper)))


def joint_log_score(log_likelihood: ArrayLike) -> float:
    """log p(y | data) = log mean_s p(y | theta_s) of all readings of a record; larger is better.

    Parameters
    ----------
    log_likelihood : log p(y | theta_s) (S,) of the record under each posterior draw; -inf for a
        draw without a response.
    """
    from scipy.special import logsumexp

    log_likelihood = np.asarray(log_likelihood, dtype=float)
    if log_likelihood.ndim != 1 or log_likelihood.size == 0:
        raise ValueError(f"log_likelihood must be (S,), got shape {log_likelihood.shape}")
    return float(logsumexp(log_likelihood) - np.log(log_likelihood.size))


def draws_behind_joint_log_score(log_likelihood: ArrayLike) -> float:
    """Effective number of draws in the joint log score, (sum_s p_s)^2 / sum_s p_s^2 (Kish 1965).

    Near 1, the best draw alone determines the score. The score is then too low by an unknown
    amount, and would differ with other draws. The number is zero if no draw has a response.

    Parameters
    ----------
    log_likelihood : as in `joint_log_score`.
    """
    from scipy.special import logsumexp

    log_likelihood = np.asarray(log_likelihood, dtype=float)
    if not np.isfinite(log_likelihood).any():
        return 0.0
    return float(np.exp(2.0 * logsumexp(log_likelihood) - logsumexp(2.0 * log_likelihood)))


def uniformity_p(pit: ArrayLike) -> float:
    """p-value of a Kolmogorov-Smirnov test that values (N,) are uniform on [0, 1].

    The test assumes that the values are independent. NaN if a value is not finite.

    If p is below 0.1, or the distance is at least 0.5, p is twice the exact one-sided probability
    (error below 1e-4). Otherwise p follows from the limiting law at a corrected distance (Vrbik
    2018, Pioneer J. Theor. Appl. Stat. 15), with an error below 1e-3 for 20 or more points.
    """
    from scipy.special import kolmogorov, smirnov

    pit = np.sort(np.asarray(pit, dtype=float))
    if not np.isfinite(pit).all():
        return float("nan")
    n = pit.size
    distance = float(np.max([np.arange(1, n + 1) / n - pit, pit - np.arange(n) / n]))
    twice = 2.0 * float(smirnov(n, distance))
    if twice < 0.1 or distance >= 0.5:
        return twice
    root = np.sqrt(n)
    corrected = distance * root + 1.0 / (6.0 * root) + (distance * root - 1.0) / (4.0 * n)
    return float(kolmogorov(corrected))


def _curves(observed: ArrayLike, predicted: ArrayLike) -> tuple[FloatArray, FloatArray]:
    observed, predicted = _same_length(observed, predicted)
    span = np.ptp(observed)
    if not np.isfinite(span) or span == 0.0:
        raise ValueError("a relative error needs finite observations that vary")
    return observed, predicted


def _same_length(observed: ArrayLike, other: ArrayLike) -> tuple[FloatArray, FloatArray]:
    observed, other = np.asarray(observed, dtype=float), np.asarray(other, dtype=float)
    # Broadcasting would accept a single value for a whole record.
    if observed.ndim != 1 or other.ndim == 0 or other.shape[-1] != observed.size:
        raise ValueError(
            f"observations {observed.shape} and predictions {other.shape} differ in length"
        )
    return observed, other


def error_row(experiment: Experiment, samples: Samples, extrapolation: str) -> dict[str, object]:
    """Errors of the posterior median curve with their posterior intervals, and scores of bands.

    e_rms and e_m are defined in equations.md section 4. They are in percent, and NaN if the
    record does not vary. Their intervals are quantiles of the draws' errors. Coverage refers to
    the predictive band, and CRPS to one predictive sample per draw. Both are NaN if fewer than
    two draws have a response, or if the noise is not known. `joint_log_score` is log mean_s
    p(y | theta_s), where p is zero for a failed draw. `joint_log_score_draws` is the effective
    number of draws in that mean. `pit_p` tests whether the probability integral transforms are
    uniform.
    """
    observed = experiment.response
    median = np.median(samples.parameter, axis=0)
    row: dict[str, object] = {
        "experiment": experiment.name,
        "role": experiment.role,
        "protocol": experiment.protocol,
    }
    for name, measure in (("e_rms", relative_rms_error), ("e_m", relative_maximum_error)):
        value = low = high = np.nan
        if np.ptp(observed) > 0.0:
            value = 100.0 * measure(observed, median[None])[0]
            low, high = np.quantile(100.0 * measure(observed, samples.parameter), [0.05, 0.95])
        row[f"{name}_percent"] = float(value)
        row[f"{name}_q05"], row[f"{name}_q95"] = float(low), float(high)
    predictive = samples.predictive
    known = len(predictive) > 1 and bool(np.isfinite(predictive).all())
    for level, band in zip(LEVELS, samples.bands["predictive"], strict=True):
        covered = interval_coverage(observed, *band) if known else np.nan
        row[f"coverage_{round(100 * level)}"] = covered
    row["crps"] = float(np.mean(crps(observed, predictive))) if known else np.nan
    row["pit_p"] = uniformity_p(samples.pit)
    row["extrapolation"] = extrapolation
    if samples.log_density is not None:
        row["joint_log_score"] = joint_log_score(samples.log_density)
        row["joint_log_score_draws"] = draws_behind_joint_log_score(samples.log_density)
    row["failed_draws"] = samples.failed
    return row


NARROW_COVERAGE = 0.7
"""If a smaller share of a record's points lies in its 90 % band, the band is too narrow."""
REJECTED = 1e-3
"""If the `pit_p` of a fitted record is smaller, the record's residuals reject the model."""
MOST_NAMED = 4
SCORED_DRAWS = "posterior_draws"
"""Column of errors.csv that identifies the draws which were scored."""
UNCHECKED = "so it is not known whether bands are wide enough for records outside the fit"


def missed(errors: pd.DataFrame) -> pd.DataFrame:
    """Select the rows of errors.csv of held-out records that the 90 % predictive band misses."""
    held_out = errors[errors["role"] == "validate"]
    return held_out[held_out["coverage_90"] < NARROW_COVERAGE]


def rejected(errors: pd.DataFrame) -> pd.DataFrame:
    """Select the rows of errors.csv of fitted records whose residuals or bands reject the model."""
    fitted = errors[errors["role"] == "calibrate"]
    return fitted[(fitted["coverage_90"] < NARROW_COVERAGE) | (fitted["pit_p"] < REJECTED)]


def note_beside(posterior: Path, draws: str, none_held_out: bool) -> str:
    """Warn if the errors.csv beside a posterior.nc shows too narrow bands; empty if it does not.

    A missing errors.csv, or one of other draws, gives a warning too.

    Parameters
    ----------
    draws : text that identifies the posterior's draws (`sum_of_draws`).
    none_held_out : the study holds out no record, so that there is nothing to score.
    """
    import pandas as pd

    table = posterior.with_name("errors.csv")
    try:
        errors = pd.read_csv(table)
    except (OSError, ValueError):  # no file, or not a table
        errors = pd.DataFrame()
    if SCORED_DRAWS in errors and (errors[SCORED_DRAWS] == draws).all():
        return _too_narrow(errors)
    if none_held_out:
        return ""
    if table.is_file():
        return (
            f"errors.csv beside the posterior is not of its draws, {UNCHECKED}; score them again "
            "(`deabayes predict` without --excitation), or copy the errors.csv that belongs to it"
        )
    return (
        f"held-out scores (errors.csv) are not beside the posterior, {UNCHECKED}; copy errors.csv "
        "to the same folder"
    )


def _too_narrow(errors: pd.DataFrame) -> str:
    """Say how many held-out records the bands miss, and which; empty if they miss none."""
    rows = missed(errors).sort_values("coverage_90")
    if rows.empty:
        return ""
    shares = [
        f"{100 * row['coverage_90']:.0f} % of {row['experiment']}"
        for _, row in rows.head(MOST_NAMED).iterrows()
    ]
    more = f" (and {len(rows) - MOST_NAMED} more records)" if len(rows) > MOST_NAMED else ""
    return (
        f"the 90 % bands of {len(rows)} of {(errors['role'] == 'validate').sum()} held-out records "
        f"are too narrow: they hold {', '.join(shares)}{more}. Bands of other excitations may be "
        "too narrow as well"
    )
