"""The content of a posterior file, with warnings for the reader."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd

from deabayes.experiment import FloatArray, Specimen
from deabayes.inference.default_priors import resolved_time
from deabayes.inference.log_posterior import LogPosterior
from deabayes.posteriors.inheritance import Inheritance
from deabayes.posteriors.records import CountedRecord
from deabayes.posteriors.sensitivity import leaning
from deabayes.prior.from_posterior import LARGEST_MISFIT
from deabayes.prior.joint import Prior
from deabayes.quantities import with_unit
from deabayes.sampling.engine import Sampled
from deabayes.study import Study

STORED_DRAWS = 2000
PRIOR_DRAWS = 4000
OUTER = 0.95
"""Quantile of a time constant's draws that should not exceed the longest record. The opposite
quantile should not be below what the records resolve."""
RIM = 0.01
"""Warn if a smaller share of the inherited prior's draws is as unlikely as the posterior's."""


@dataclass(frozen=True)
class PosteriorContent:
    """The draws of a candidate, with diagnostics and warnings.

    `z` (E, S, d) are thinned draws of the E independent ensembles in the prior's standard-normal
    coordinate. `log_posterior` (E, S) is their log density. `diagnostics` is indexed by quantity.
    `convergence` says in words what failed. `further` is the prior of parameters that only
    predictions need (see `default_priors.further_prior`). `counted_before` are the records that
    the prior already uses. `leaning` says which parameters lean on a bound of their prior.
    """

    study: Study
    candidate: str
    specimen: Specimen
    target: LogPosterior
    z: FloatArray
    log_posterior: FloatArray
    diagnostics: pd.DataFrame
    convergence: Mapping[str, object]
    warnings: Sequence[str]
    seed: np.random.SeedSequence
    further: Prior | None = None
    counted_before: Sequence[CountedRecord] = ()
    leaning: Sequence[str] = ()

    @classmethod
    def of(
        cls,
        study: Study,
        candidate: str,
        target: LogPosterior,
        sampled: Sampled,
        seed: np.random.SeedSequence,
        further: Prior | None = None,
        inherited: Inheritance | None = None,
        unexpected: Sequence[str] = (),
    ) -> PosteriorContent:
        """Collect the content, with at most `STORED_DRAWS` draws per ensemble.

        `unexpected` says which records the prior does not expect.
        """
        z, log_posterior = sampled.thinned(STORED_DRAWS)
        theta = target.prior.to_parameters(z.reshape(-1, z.shape[2]))
        experiments = [record.experiment for record in target.records]
        return cls(
            study,
            candidate,
            target.system.specimen,
            target,
            z,
            log_posterior,
            sampled.convergence.table,
            _with_doubts(convergence_summary(sampled), inherited),
            [
                *(f"{e.name}: {warning}" for e in experiments for warning in e.warnings),
                *unexpected,
                *times_off_records(target, theta),
                *_notes(target.prior, inherited),
                *at_the_rim(target.prior, theta),
            ],
            seed,
            further,
            inherited.counted if inherited else (),
            leaning(target.prior, theta),
        )


def times_off_records(target: LogPosterior, theta: FloatArray) -> list[str]:
    """Warn of relaxation times that, by draws theta (W, d), no calibrated record may show.

    Stiffness and time constant of a slow unit trade along a long ridge: the records show little
    more than their ratio. Sampling is slow because data are missing, not steps. A fast unit shares
    its modulus with the spring. Inherited parameters are not checked, because other records of
    another study may have determined them.
    """
    timed = [r.experiment for r in target.records if r.experiment.coordinate_name == "time"]
    if not timed:
        return []
    longest = max(experiment.elapsed for experiment in timed)
    shortest = target.system.time_scale * min(resolved_time(experiment) for experiment in timed)
    inherited = {name for block in target.prior.inherited for name in block.names}
    warnings = []
    for parameter, draws in zip(target.prior.parameters, theta.T, strict=True):
        if not parameter.is_time_constant or parameter.name in inherited:
            continue
        low, high = np.quantile(draws, [1.0 - OUTER, OUTER])
        share = f"{parameter.name}: {100 * (1 - OUTER):.0f} % of its draws are"
        if high > longest:
            warnings.append(
                f"{share} above {high:.3g} s, but the longest calibrated record lasts "
                f"{longest:.3g} s. Stiffness and time constant of so slow a unit cannot be "
                "separated. Record longer, or let the preparation crop less; more sampling steps "
                "do not help"
            )
        if low < shortest:
            below, least = (with_unit(time, "s", digits=3) for time in (low, shortest))
            warnings.append(
                f"{share} below {below}, but no calibrated record shows times below {least}. So "
                f"fast a unit looks like a spring, or like no unit. Begin its prior at {least}: "
                "runs can miss a part of such a posterior and still agree"
            )
    return warnings


def _with_doubts(
    convergence: dict[str, object], inherited: Inheritance | None
) -> dict[str, object]:
    """Mark a posterior as not converged if its inherited prior did not converge."""
    if inherited is None or not inherited.doubts:
        return convergence
    reasons = convergence["reasons"]
    assert isinstance(reasons, list)
    return {**convergence, "converged": False, "reasons": [*reasons, *inherited.doubts]}


def _notes(prior: Prior, inherited: Inheritance | None) -> list[str]:
    """Return the warnings about a prior that comes from another posterior."""
    notes = [] if inherited is None else list(inherited.notes)
    return notes + [
        "prior_from: the density fitted to the inherited draws does not describe them (largest "
        f"distance of distribution functions {block.misfit:.2f}); this prior is approximate"
        for block in prior.inherited
        if block.misfit > LARGEST_MISFIT
    ]


def at_the_rim(prior: Prior, theta: FloatArray) -> list[str]:
    """Warn if new records pull inherited parameters to where their prior has hardly any draws.

    The check computes the density of the inherited prior. It counts the prior draws whose density
    is at most the median over the posterior's draws theta (W, d) (Box 1980, J. R. Stat. Soc. A
    143).
    """
    if not prior.inherited:
        return []
    drawn = prior.sample(np.random.default_rng(0), PRIOR_DRAWS)
    before, after = (prior.log_density_of_inherited(draws) for draws in (drawn, theta))
    share = float(np.mean(before <= np.median(after)))
    if share >= RIM:
        return []
    names = ", ".join(name for block in prior.inherited for name in block.names)
    return [
        f"prior_from: these records pull {names} to the edge of the other posterior "
        f"({100.0 * share:.2g} % of its own draws are as unlikely). Check that it is the same "
        "material and that the model fits both; fit the records together to find out "
        "(docs/how-to/prior-from.md)"
    ]


def convergence_summary(sampled: Sampled) -> dict[str, object]:
    """Summarise for a reader how the draws were made, and whether they converged."""
    convergence, table = sampled.convergence, sampled.convergence.table
    shares = convergence.mode_shares
    kept = sampled.steps - sampled.burn_in
    return {
        "converged": bool(convergence.converged),
        "reasons": [str(each) for each in convergence.failed],
        "failed_gates": [asdict(each) for each in convergence.failed],
        "r_hat_max": float(table["r_hat"].max()),
        "ess_bulk_min": float(table["ess_bulk"].min()),
        "ess_tail_min": float(table["ess_tail"].min()),
        "autocorrelation_times": [float(each) for each in convergence.autocorrelation_times],
        "length": convergence.length,
        "tau": float(kept / max(convergence.length, 1e-3)),
        "steps": sampled.steps,
        "walkers": int(sampled.chain.shape[2]),
        "ensembles": len(sampled.chain),
        "acceptance": sampled.acceptance,
        "refitted": sampled.rounds > 1,
        "failures": {"evaluations": sampled.evaluations, "failed": sampled.failures},
        "mode_shares": [] if shares is None else shares.to_numpy().tolist(),
    }
