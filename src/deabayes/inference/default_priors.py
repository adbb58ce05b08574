"""Default priors adapted to the records, and models that predict held-out protocols."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from deabayes.experiment import Experiment, FloatArray, Specimen
from deabayes.prior.distributions import Distribution, LogNormal, LogUniform
from deabayes.prior.joint import Prior, PriorFromPosterior
from deabayes.prior.parameter import Parameter
from deabayes.study import Study
from deabayes.systems import build as build_system
from deabayes.systems.base import System

STIFF = ("Pa", "Pa s", "N/m", "N s/m")
"""Units of moduli, stiffnesses and viscosities."""
WIDE = 2.0
"""Sigma from which a log-normal prior is not shifted, because it already spans three decades."""
LENGTHS = 4.0
"""Longest relaxation time in lengths of the longest record; a slower unit acts like a spring."""
RELAXED = 4.0
"""Relaxation times after a step at which 98 % of a unit's relaxation is over."""
DECADES = np.arange(-2, 3)
"""Decades by which a material may be stiffer than in the literature."""
ALIKE = 0.5
"""Decades by which a shift of moduli must bring the model's responses closer to the records'."""


def adapted_to_records(
    parameters: Sequence[Parameter],
    system: System,
    experiments: Sequence[Experiment],
    overrides: Mapping[str, object],
    inherited: Collection[str] = (),
) -> tuple[Parameter, ...]:
    """Return a system's parameters with default priors adapted to the calibration records.

    Relaxation times are log-uniform from the shortest time that the records resolve (see
    `resolved_time`) to four lengths of the longest record, times `System.time_scale`. Moduli,
    stiffnesses and viscosities are shifted by the whole decades that make the responses of the
    median model as large as the records'. Wide priors are not shifted. The priors of a user's own
    system do not change.

    Parameters
    ----------
    overrides : priors set by the study, by parameter or group.
    inherited : names of parameters whose prior is another study's posterior.
    """
    from deabayes.systems import OWN

    timed = [record for record in experiments if record.coordinate_name == "time"]
    if not experiments or type(system) in OWN.values():
        return tuple(parameters)
    if timed:
        prior, source = _relaxation_times(timed, system.time_scale)
        parameters = [
            replace(p, prior=prior, source=source)
            if p.is_time_constant and p.name not in inherited
            else p
            for p in parameters
        ]
    return _stiffened(parameters, system, experiments, overrides, inherited)


def _relaxation_times(timed: Sequence[Experiment], scale: float) -> tuple[Distribution, str]:
    shortest = min(resolved_time(record) for record in timed)
    longest = max(record.elapsed for record in timed)
    source = (
        f"from the shortest time that the records resolve, {shortest:.2g} s, to {LENGTHS:g} "
        f"lengths of the longest record, {longest:.3g} s"
    )
    if scale != 1.0:
        source += f", times {scale:.3g}: a unit relaxes with 1/{scale:.3g} of it at rest"
    return LogUniform(scale * shortest, scale * LENGTHS * longest), source


def resolved_time(record: Experiment) -> float:
    """Shortest relaxation time [s] that a record can show.

    It is the shortest interval between points. If points come late after every change of the
    excitation, it is the shortest such delay over `RELAXED`: a faster unit looks like a spring,
    however close together the points are.
    """
    times, knots = np.sort(record.coordinate), record.excitation.coordinate
    interval = float(np.diff(np.unique(times)).min(initial=record.elapsed))
    with np.errstate(divide="ignore", invalid="ignore"):
        rates = np.diff(record.excitation.values) / np.diff(knots)
    changes = np.concatenate([knots[:1], knots[1:-1][np.diff(rates) != 0.0]])
    driven = times[times >= changes[0]]
    delays = driven - changes[np.searchsorted(changes, driven, side="right") - 1]
    return max(interval, float(delays.min(initial=record.elapsed)) / RELAXED)


def _stiffened(
    parameters: Sequence[Parameter],
    system: System,
    experiments: Sequence[Experiment],
    overrides: Mapping[str, object],
    inherited: Collection[str],
) -> tuple[Parameter, ...]:
    """Shift moduli, stiffnesses and viscosities by the decades that fit the records best."""
    prior = Prior.from_parameters(parameters, overrides, overrides)
    shifted = [
        p.name
        for p in prior.parameters
        if p.unit in STIFF and p.source != "config" and p.name not in inherited
        and isinstance(p.prior, LogNormal) and p.prior.sigma < WIDE
    ]  # fmt: skip
    decades = _decades(prior, system, experiments, shifted) if shifted else 0
    if decades == 0:
        return tuple(parameters)
    return tuple(
        replace(
            p,
            prior=LogNormal(10.0**decades * p.prior.median, p.prior.sigma),
            source=f"{p.source}; times 1e{decades:d}, as stiff as the records are",
        )
        if p.name in shifted and isinstance(p.prior, LogNormal)
        else p
        for p in parameters
    )


def _decades(
    prior: Prior, system: System, experiments: Sequence[Experiment], shifted: Sequence[str]
) -> int:
    """Number of decades by which the median model must be stiffer to match the records."""
    middle = prior.to_parameters(np.zeros((1, len(prior.names))))[0]
    draws = {n: np.full(DECADES.size, v) for n, v in zip(prior.names, middle, strict=True)}
    draws |= {name: draws[name] * 10.0**DECADES for name in shifted}
    distance = np.zeros(DECADES.size)
    for record in experiments:
        measured = _size(system, record, record.response)
        with np.errstate(all="ignore"):
            simulated = _size(system, record, system.simulator_of(record)(draws))
            distance += np.abs(np.log10(simulated / measured))
    distance = np.where(np.isfinite(distance), distance / len(experiments), np.inf)
    best, unshifted = int(np.argmin(distance)), int(np.flatnonzero(DECADES == 0)[0])
    return int(DECADES[best]) if distance[best] < distance[unshifted] - ALIKE else 0


def _size(system: System, experiment: Experiment, response: FloatArray) -> FloatArray:
    """Largest magnitude of a response over the points, or its range if not zero at rest."""
    if experiment.response_name in system.zero_at_rest:
        return np.asarray(np.max(np.abs(response), axis=-1))
    return np.asarray(np.ptp(response, axis=-1))


def wider_systems(study: Study, system: System) -> dict[str, System]:
    """Protocol -> the system that predicts its held-out records."""
    specimen, candidate = system.specimen, system.candidate
    return {
        protocol: build_system(specimen.system, candidate + ending, specimen)
        for protocol, ending in study.predict_with.items()
    }


def further_prior(
    study: Study,
    system: System,
    fitted: Sequence[str],
    inherited: PriorFromPosterior | None = None,
) -> Prior | None:
    """The prior of the parameters that only `predict_with` needs; None if there are none.

    The fitted records do not depend on these parameters, so this prior is their posterior.

    Parameters
    ----------
    fitted : names of the parameters that the fit of `system` samples.
    inherited : names and draws (S, k) of another study's posterior.
    """
    further = {
        parameter.name: parameter
        for wide in wider_systems(study, system).values()
        for parameter in wide.parameters()
        if parameter.name not in fitted
    }
    if not further:
        return None
    # The fit has refused names that are in no model.
    prior = Prior.from_parameters(further.values(), study.priors, study.priors)
    if inherited is not None and set(inherited.names) & set(prior.names):
        prior = prior.inherit(*inherited)
    return prior


def only_for_predictions(
    inherited: PriorFromPosterior, prior: Prior, study: Study, specimen: Specimen
) -> bool:
    """Whether `prior_from` has parameters that only `predict_with` adds, and none of the fit."""
    names = set(inherited.names)
    further = set(names_of_all(study, specimen)) if study.predict_with else set()
    return not names & set(prior.names) and bool(names & further)


def names_of_all(study: Study, specimen: Specimen) -> tuple[str, ...]:
    """Names that `priors` may have for any candidate, or for any model that predicts with it."""
    models = [
        build_system(specimen.system, candidate + ending, specimen)
        for candidate in study.candidates
        for ending in ("", *study.predict_with.values())
    ]
    return prior_names(models)


def prior_names(systems: Iterable[System]) -> tuple[str, ...]:
    """Names of the systems' parameters, of their ordered groups and of their totals."""
    every = [parameter for system in systems for parameter in system.parameters()]
    names = (name for p in every for name in (p.name, p.ordered, p.part_of) if name)
    return tuple(dict.fromkeys(names))
