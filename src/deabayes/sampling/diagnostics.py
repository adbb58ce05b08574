"""Whether the runs may be believed: the gates of convergence, said in plain words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.sampling import chains
from deabayes.sampling.gates import Failed
from deabayes.sampling.mode_shares import mode_shares
from deabayes.study import Sampling

if TYPE_CHECKING:
    import pandas as pd

TAU_TOLERANCE = 0.05
LONG_ENOUGH, LOOSE_TAU_TOLERANCE = 1.5, 0.15
"""Where every run is half as long again as asked for, tau may change by this much.

A walker that now and then sits still makes tau itself uncertain: of simulated stationary runs
of 120 tau that hold such walkers, the tolerance of 5 % alone lets 28 % pass, this rule 53 %; of
runs that are too short (33 and 46 tau) 12 and 45 % pass by either, or 12 and 47 %
(docs/sampler.md)."""
BURN_IN_TIMES = 5.0
GATE_STEPS = 400
"""Steps per walker that statistics are computed from; more change none of them visibly."""


@dataclass(frozen=True)
class Convergence:
    """The verdict on a set of runs.

    Attributes
    ----------
    converged : all gates passed.
    failed : gates that were not passed, one per quantity, run or mode.
    table : one row per quantity with columns mean, sd, median, q05, q95, mcse_mean,
        ess_bulk, ess_tail, r_hat.
    autocorrelation_times : (E,) how many autocorrelation times each run covers.
    mode_shares : one row per mode, one column per run, the share of its draws there.
    agree : no gate failed but those of length: runs do not disagree, and no walker is stuck.
    """

    converged: bool
    failed: list[Failed]
    table: pd.DataFrame
    autocorrelation_times: FloatArray
    mode_shares: pd.DataFrame | None = None
    agree: bool = True

    @property
    def reasons(self) -> list[str]:
        """One sentence per gate and quantity, run or mode that did not pass it."""
        return [str(each) for each in self.failed]


def summarise(quantities: Mapping[str, FloatArray]) -> pd.DataFrame:
    """The table of `Convergence` for quantities (E, S, W)."""
    import pandas as pd

    rows = {name: _summary(np.asarray(values, float)) for name, values in quantities.items()}
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("quantity")


def _summary(values: FloatArray) -> dict[str, float]:
    values = values[:, chains.thin_evenly(values.shape[1], GATE_STEPS)]
    sd = values.std(ddof=1)
    low, median, high = np.quantile(values, [0.05, 0.5, 0.95])
    return {
        "mean": float(values.mean()),
        "sd": float(sd),
        "median": float(median),
        "q05": float(low),
        "q95": float(high),
        "mcse_mean": float(sd / np.sqrt(chains.ess_mean(values))),
        "ess_bulk": chains.ess_bulk(values),
        "ess_tail": chains.ess_tail(values),
        "r_hat": chains.r_hat(values),
    }


def autocorrelation_times(quantities: Mapping[str, FloatArray]) -> FloatArray:
    """How many autocorrelation times each run (E,) covers, for its slowest quantity.

    With tau = draws / (smallest bulk effective sample size pooled over walkers), the
    steps divided by tau are that size divided by the number of walkers.
    """
    covered = []
    for values in quantities.values():
        values = values[:, chains.thin_evenly(values.shape[1], GATE_STEPS)]
        walkers = values.shape[2]
        covered.append([chains.ess_bulk(run[None]) / walkers for run in values])
    return np.min(covered, axis=0)


def assess(
    quantities: Mapping[str, FloatArray],
    settings: Sampling,
    *,
    dropped: FloatArray | None = None,
    log_posterior: FloatArray | None = None,
    draws: FloatArray | None = None,
) -> Convergence:
    """Apply every gate to quantities (E, S, W): parameters and derived ones alike.

    Parameters
    ----------
    dropped : (E,) steps dropped at the start of each run, over the steps kept.
    log_posterior : (E, S, W), for the check on stuck walkers.
    draws : (E, S, W, d) in z, for the check on the shares of modes.
    """
    table = summarise(quantities)
    times = autocorrelation_times(quantities)
    disagreeing = _not_numbers(quantities)
    lost = {each.of for each in disagreeing}
    disagreeing += _r_hats(table.drop(index=list(lost)), settings)
    short = _sizes(table, settings) + _lengths(times, settings)
    short += _changing_times(quantities, times, settings)
    if dropped is not None:
        short += _burn_ins(np.asarray(dropped) * times)
    if log_posterior is not None:
        disagreeing += _stuck(log_posterior)
    shares = None
    if draws is not None:
        shares, weighed_otherwise = mode_shares(draws)
        disagreeing += weighed_otherwise
    failed = disagreeing + short
    return Convergence(not failed, failed, table, times, shares, agree=not disagreeing)


def _not_numbers(quantities: Mapping[str, FloatArray]) -> list[Failed]:
    text = "some draws are not a number, so it cannot be judged"
    return [
        Failed("finite", name, text, 0.0, longer=False)
        for name, values in quantities.items()
        if not np.isfinite(values).all()
    ]


def _r_hats(table: pd.DataFrame, settings: Sampling) -> list[Failed]:
    failed = []
    for name, row in table.iterrows():
        if not row["r_hat"] < settings.r_hat:
            text = (
                f"R-hat {row['r_hat']:.3f} is not below {settings.r_hat:g}: "
                "the independent runs disagree"
            )
            failed.append(Failed("r_hat", str(name), text, float(row["r_hat"])))
    return failed


def _sizes(table: pd.DataFrame, settings: Sampling) -> list[Failed]:
    return [
        Failed(
            column,
            str(name),
            f"the {meaning} of the distribution rests on {row[column]:.0f} effective draws, "
            f"fewer than {settings.ess:g}",
            -float(row[column]),
        )
        for name, row in table.iterrows()
        for column, meaning in (("ess_bulk", "bulk"), ("ess_tail", "tail"))
        if row[column] < settings.ess
    ]


def _lengths(times: FloatArray, settings: Sampling) -> list[Failed]:
    return [
        Failed(
            "length",
            f"run {run}",
            f"only {covered:.0f} autocorrelation times long, fewer than "
            f"{settings.autocorrelation_times:g}",
            -float(covered),
        )
        for run, covered in enumerate(times, start=1)
        if not covered >= settings.autocorrelation_times
    ]


def _changing_times(
    quantities: Mapping[str, FloatArray], times: FloatArray, settings: Sampling
) -> list[Failed]:
    """Compare tau of all runs with tau of their first four fifths."""
    ample = bool(np.all(times >= LONG_ENOUGH * settings.autocorrelation_times))
    tolerance = LOOSE_TAU_TOLERANCE if ample else TAU_TOLERANCE
    # Thinned before it is cut: another stride would be another autocorrelation time.
    kept = chains.thin_evenly(next(iter(quantities.values())).shape[1], GATE_STEPS)
    early = kept[: kept.size * 4 // 5]
    sizes = {name: chains.ess_bulk(values[:, kept]) for name, values in quantities.items()}
    slowest = min(sizes, key=lambda name: sizes[name])
    tau = kept.size / sizes[slowest]
    before = early.size / chains.ess_bulk(quantities[slowest][:, early])
    change = abs(tau / before - 1)
    if change <= tolerance:
        return []
    text = (
        f"the autocorrelation time still changes by {change:.0%} over the last fifth "
        f"of the runs, more than {tolerance:.0%}"
    )
    return [Failed("tau", slowest, text, change)]


def _burn_ins(times: FloatArray) -> list[Failed]:
    return [
        Failed(
            "burn_in",
            f"run {run}",
            f"only {dropped:.1f} autocorrelation times were dropped at its start, "
            f"fewer than {BURN_IN_TIMES:g}",
            -float(dropped),
        )
        for run, dropped in enumerate(times, start=1)
        if not dropped >= BURN_IN_TIMES
    ]


def stuck_walkers(log_posterior: FloatArray) -> FloatArray:
    """Which walkers (E, W) stayed put over half the steps, or far below all the others.

    Far below: the time average is under what the median walker goes below in half a per
    cent of its steps; log_posterior is (E, S, W).
    """
    half = log_posterior[:, log_posterior.shape[1] // 2 :]
    frozen = (half == half[:, :1]).all(axis=1)
    lowest = np.median(np.quantile(log_posterior, 0.005, axis=1))
    return frozen | (log_posterior.mean(axis=1) < lowest)


def _stuck(log_posterior: FloatArray) -> list[Failed]:
    return [
        Failed(
            "stuck",
            f"run {run}",
            f"{stuck.sum()} of {len(stuck)} walkers are stuck (they did not move, or "
            "stay where the posterior is far lower than elsewhere); start again with another seed",
            float(stuck.sum()),
            longer=False,
        )
        for run, stuck in enumerate(stuck_walkers(log_posterior), start=1)
        if stuck.any()
    ]
