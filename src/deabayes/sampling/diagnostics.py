"""Convergence gates that decide whether runs can be trusted, with reasons in plain words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deabayes.experiment import FloatArray
from deabayes.sampling import chains
from deabayes.sampling.mixture import Mixture, fit
from deabayes.study import Sampling

if TYPE_CHECKING:
    import pandas as pd

GATE_STEPS = 400
"""Most steps per walker from which statistics are computed; more steps hardly change them."""

LONGER = "sample longer"


@dataclass(frozen=True)
class Failed:
    """A gate that a quantity, a run or a mode did not pass.

    Attributes
    ----------
    gate : name of the gate. Failures of the same gate may be reported together.
    of : the quantity, run or mode.
    text : what is wrong.
    badness : compares failures of the same gate: the larger, the worse.
    longer : whether more steps of the same kind may help.
    """

    gate: str
    of: str
    text: str
    badness: float
    longer: bool = True

    def __str__(self) -> str:
        return f"{self.of}: {self.text}; {LONGER}" if self.longer else f"{self.of}: {self.text}"


@dataclass(frozen=True)
class Convergence:
    """The verdict on a set of runs.

    Attributes
    ----------
    converged : whether all gates were passed.
    failed : the failed gates, one per quantity, run or mode.
    table : one row per quantity with columns mean, sd, median, q05, q95, mcse_mean,
        ess_bulk, ess_tail, r_hat.
    autocorrelation_times : (E,), number of autocorrelation times that each run covers.
    length : the same number, computed with the mean autocorrelation time of all runs.
    mode_shares : share of a run's draws in each mode; one row per mode, one column per run.
    """

    converged: bool
    failed: list[Failed]
    table: pd.DataFrame
    autocorrelation_times: FloatArray
    length: float
    mode_shares: pd.DataFrame | None = None

    @property
    def reasons(self) -> list[str]:
        """One sentence for each quantity, run or mode that failed a gate."""
        return [str(failure) for failure in self.failed]

    @property
    def smallest_ess(self) -> float:
        """The smallest bulk or tail effective sample size of all quantities."""
        return float(self.table[["ess_bulk", "ess_tail"]].min().min())

    @property
    def has_stuck(self) -> bool:
        """Whether walkers are stuck."""
        return any(failure.gate == "stuck" for failure in self.failed)


def summarise(quantities: Mapping[str, FloatArray]) -> pd.DataFrame:
    """Return the table of `Convergence` for quantities (E, S, W)."""
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
    """Return how many autocorrelation times each run (E,) covers, for its slowest quantity.

    With tau = draws / (smallest bulk effective sample size pooled over walkers), steps / tau is
    that effective sample size divided by the number of walkers.
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
    log_posterior: FloatArray | None = None,
    draws: FloatArray | None = None,
) -> Convergence:
    """Apply every gate to quantities (E, S, W), both parameters and derived quantities.

    Parameters
    ----------
    log_posterior : (E, S, W), for the check for stuck walkers.
    draws : (E, S, W, d) in z, for the check of the mode shares.
    """
    table = summarise(quantities)
    times = autocorrelation_times(quantities)
    length = float(1.0 / np.mean(1.0 / times))
    failed = _not_numbers(quantities)
    failed += _r_hats(table.drop(index=[failure.of for failure in failed]), settings)
    if log_posterior is not None:
        failed += _stuck(log_posterior)
    shares = None
    if draws is not None:
        shares, disagreements = mode_shares(draws)
        failed += disagreements
    failed += _sizes(table, settings) + _too_short(length, settings)
    return Convergence(not failed, failed, table, times, length, shares)


def _not_numbers(quantities: Mapping[str, FloatArray]) -> list[Failed]:
    text = "some draws are not a number, so it cannot be judged"
    return [
        Failed("finite", name, text, 0.0, longer=False)
        for name, values in quantities.items()
        if not np.isfinite(values).all()
    ]


def _r_hats(table: pd.DataFrame, settings: Sampling) -> list[Failed]:
    return [
        Failed(
            "r_hat",
            str(name),
            f"R-hat {value:.3f} is not below {settings.r_hat:g}: the independent runs disagree",
            float(value),
        )
        for name, value in table["r_hat"].items()
        if not value < settings.r_hat
    ]


def _sizes(table: pd.DataFrame, settings: Sampling) -> list[Failed]:
    return [
        Failed(
            column,
            str(name),
            f"the {meaning} of the distribution has {row[column]:.0f} effective draws, "
            f"fewer than {settings.ess:g}",
            -float(row[column]),
        )
        for name, row in table.iterrows()
        for column, meaning in (("ess_bulk", "bulk"), ("ess_tail", "tail"))
        if row[column] < settings.ess
    ]


def _too_short(length: float, settings: Sampling) -> list[Failed]:
    """Check that the runs are long enough to trust the autocorrelation time.

    The check uses the mean autocorrelation time of the runs. Each run sees only its share of the
    draws, so the longest time of four runs is mostly too long. R-hat and the mode shares show
    whether runs differ.
    """
    if length >= settings.autocorrelation_times:
        return []
    text = (
        f"only {length:.0f} autocorrelation times long, fewer than "
        f"{settings.autocorrelation_times:g}"
    )
    return [Failed("length", "the runs", text, -length)]


def stuck_walkers(log_posterior: FloatArray) -> NDArray[np.bool_]:
    """Return which walkers (E, W) did not move in the second half, or stayed far below the others.

    Every walker has a level that it goes below in half a per cent of its steps. Far below means
    that a walker's mean is below the median of these levels. `log_posterior` is (E, S, W).
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
            f"{stuck.sum()} of {len(stuck)} walkers are stuck: they did not move, or their "
            "posterior density is far below the others'; start again with another seed",
            float(stuck.sum()),
            longer=False,
        )
        for run, stuck in enumerate(stuck_walkers(log_posterior), start=1)
        if stuck.any()
    ]


def mode_shares(
    draws: FloatArray, components: int = 8, sample: int = 6000
) -> tuple[pd.DataFrame, list[Failed]]:
    """Return the share of every run's draws (E, S, W, d) in each mode, and where the runs disagree.

    A mixture is fitted to the pooled draws. Components that share more than one per cent of their
    draws form one mode. A run disagrees if its share differs from the pooled share by more than
    four standard errors plus half a per cent. It also disagrees if it has missed a mode: its share
    is less than a fifth of a pooled share above one per cent.

    If no mode fails, the same check is made for the components of modes with several components.
    It finds runs that disagree on a small component beside a large one. It also finds runs that
    agree in every coordinate, but not in their joint distribution.
    """
    import pandas as pd

    runs, steps, _, dimension = draws.shape
    flat = draws.reshape(-1, dimension)
    flat = flat[chains.thin_evenly(len(flat), sample)]
    mixture = fit(flat, components, np.random.default_rng(0))
    kept = draws[:, chains.thin_evenly(steps, 200)]
    cell = mixture.component_log_density(kept.reshape(-1, dimension)).argmax(axis=1)
    cell, joined = cell.reshape(kept.shape[:3]), _modes(mixture, flat)
    mode = joined[cell]
    labels = [f"run {run}" for run in range(1, runs + 1)]
    inside = [(mode == index).astype(float) for index in np.unique(mode)]
    inside.sort(key=lambda in_mode: -in_mode.mean())
    table = pd.DataFrame([in_mode.mean(axis=(1, 2)) for in_mode in inside], columns=labels)
    table.index = pd.RangeIndex(1, len(table) + 1, name="mode")
    failed: list[Failed] = []
    for index, in_mode in enumerate(inside, start=1):
        failed += _shares(f"mode {index}", in_mode)
    parts = [part for part in range(len(mixture.weights)) if np.sum(joined == joined[part]) > 1]
    for part in parts if not failed else ():
        failed += _shares(f"part {part + 1} of a mode", (cell == part).astype(float))
    return table, failed


def _shares(name: str, inside: FloatArray) -> list[Failed]:
    pooled, shares = inside.mean(), inside.mean(axis=(1, 2))
    sizes = [chains.ess_bulk(run[None]) for run in inside if 0 < run.mean() < 1]
    error = np.sqrt(pooled * (1 - pooled) / np.median(sizes)) if sizes else 0.0
    missed = (shares < pooled / 5) & (pooled > 0.01)
    return [
        Failed(
            "modes",
            name,
            f"it has {pooled:.1%} of all draws but {shares[run]:.1%} of run {run + 1}: "
            "the independent runs weigh the modes differently",
            float(abs(shares[run] - pooled)),
        )
        for run in np.flatnonzero((np.abs(shares - pooled) > 4 * error + 0.005) | missed)
    ]


def _modes(mixture: Mixture, z: FloatArray, overlap: float = 0.01) -> NDArray[np.intp]:
    """Return the mode (K,) of every component; components that share draws z (N, d) are joined."""
    terms = mixture.component_log_density(z)
    member = np.exp(terms - terms.max(axis=1, keepdims=True))
    member /= member.sum(axis=1, keepdims=True)
    mode = np.arange(len(mixture.weights))
    for first in range(len(mode)):
        for second in range(first):
            shared = np.minimum(member[:, first], member[:, second]).sum()
            if shared > overlap * min(member[:, first].sum(), member[:, second].sum()):
                mode[mode == mode[first]] = mode[second]
    return np.unique(mode, return_inverse=True)[1]
