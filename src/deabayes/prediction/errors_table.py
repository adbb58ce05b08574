"""One record's row of errors.csv."""

from __future__ import annotations

import numpy as np

from deabayes.experiment import Experiment
from deabayes.prediction.bands import Samples
from deabayes.prediction.errors import (
    crps,
    draws_behind_joint_log_score,
    interval_coverage,
    joint_log_score,
    relative_maximum_error,
    relative_rms_error,
    uniformity_p,
)
from deabayes.prediction.mixture_bands import LEVELS


def error_row(experiment: Experiment, samples: Samples, extrapolation: str) -> dict[str, object]:
    """Errors of the posterior median curve with their posterior intervals, and band scores.

    e_rms and e_m are those of equations.md section 4, in percent, NaN where the record does not
    vary; their intervals come from the draws' own errors. Coverage is that of the
    predictive band, CRPS that of one sample per draw of the same law, both NaN where fewer than two
    draws have a response or the noise is not known; `joint_log_score` is log mean_s p(y | theta_s),
    a failed draw's p being zero, and `joint_log_score_draws` how many draws carry that mean;
    `pit_p` tests whether the probability integral transforms are uniform.
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
