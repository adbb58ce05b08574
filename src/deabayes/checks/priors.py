"""Checks of a study's priors against parameters and records."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np

from deabayes.experiment import FREQUENCY_RESPONSE, Experiment, FloatArray
from deabayes.faults import Report, UserError
from deabayes.inference.default_priors import prior_names, wider_systems
from deabayes.prior.joint import Prior
from deabayes.prior.overrides import overridden, targets_of
from deabayes.prior.parameter import Parameter
from deabayes.quantities import with_unit
from deabayes.study import Settings, Study
from deabayes.systems import System

DRAWS = 200
FEWEST = 20
"""Fewest draws with a response that a comparison needs; with fewer, sampling hardly begins."""
POINTS = 50
OUTER = (0.05, 0.95)
OPPOSITE = -0.5
"""Correlation with the median of the draws below which a record has the opposite direction."""
BEYOND = 10.0
"""Factor beyond the outer draws above which a wrong unit is likelier than an unusual material."""


def check_priors(
    study: Study, systems: Mapping[str, System], experiments: Sequence[Experiment], report: Report
) -> None:
    """Report faults and warnings of the priors in a study.

    Faults are priors that name no parameter of any candidate, or that cannot be used. Warnings
    are numbers without a unit for parameters that have one.
    """
    from deabayes.inference.record_noise import noise_parameters
    from deabayes.noise import REGISTRY as NOISE
    from deabayes.prior.overrides import bare_numbers

    calibrate = [experiment for experiment in experiments if experiment.role == "calibrate"]
    if not systems:
        return
    first = next(iter(systems.values()))
    noise = None
    with report.catching():
        noise = noise_parameters(study, NOISE[study.noise](), calibrate, first)
    if noise is None:
        return
    models = [m for s in systems.values() for m in (s, *wider_systems(study, s).values())]
    known = prior_names(models)
    for system in systems.values():
        parameters = (*system.parameters(), *noise)
        with report.catching():
            Prior.from_parameters(parameters, study.priors, known)
            report.include(warnings=bare_numbers(parameters, study.priors, known))


def unexpected(study: Study, system: System, experiments: Iterable[Experiment]) -> list[str]:
    """Warn of records that are far off a candidate's prior in size, direction or zero.

    Held-out records are compared with the model that predicts them (`predict_with`).
    """
    wider = wider_systems(study, system)
    found: list[str] = []
    for each in experiments:
        held_out = each.role == "validate"
        model = wider.get(each.protocol, system) if held_out else system
        found += _unexpected(model, each, _draws(study, model))
    return found


def _draws(study: Study, system: System) -> dict[str, FloatArray]:
    prior = Prior.from_parameters(system.parameters(), study.priors, study.priors)
    theta = prior.sample(np.random.default_rng(0), DRAWS)
    return dict(zip(prior.names, np.ascontiguousarray(theta.T), strict=True))


def _unexpected(system: System, each: Experiment, draws: Mapping[str, FloatArray]) -> list[str]:
    kept = np.linspace(0, each.coordinate.size - 1, POINTS).round().astype(int)
    kept = np.unique([*kept, np.argmin(each.response), np.argmax(each.response)])
    at, measured = each.coordinate[kept], each.response[kept]
    with np.errstate(all="ignore"):
        curves = np.asarray(system.predict(each.excitation, at, each.response_name, draws))
    curves = curves[np.isfinite(curves).all(axis=1)]
    place = f"{each.name}: "
    if len(curves) < FEWEST:
        return [f"{place}{len(curves)} of {DRAWS} draws of the prior have a response to it; are "
                "the units of record, specimen and priors right?"]  # fmt: skip
    middle = np.median(curves, axis=0)
    if np.ptp(middle) > 0.0 and np.corrcoef(middle, measured)[0, 1] < OPPOSITE:
        return [f"{place}{_opposite(system, middle, measured, each.response_name)}"]
    return _of_another_size(curves, measured, each, place) or _off_its_zero(
        curves[:, 0], measured, each, place
    )


def _opposite(system: System, middle: FloatArray, measured: FloatArray, name: str) -> str:
    rises = middle[np.argmax(np.abs(middle - middle[0]))] > middle[0]
    found, expected = ("falls", "rise") if rises else ("rises", "fall")
    said = f"{name} {found} where the prior expects it to {expected}"
    alike = np.median(middle) * np.median(measured) > 0.0
    if name in FREQUENCY_RESPONSE and system.massless and alike:
        return (
            f"{said}: the candidate has no mass, so nothing in it resonates; take one with "
            "_inertia for this record, under candidates or by predict_with"
        )
    lag = " (lag is negative)" if name == "phase" else ""
    return f"{said}; is its sign right{lag}?"


def _of_another_size(
    curves: FloatArray, measured: FloatArray, each: Experiment, place: str
) -> list[str]:
    # One size suffices: a record may vary by noise only, or may lie far from zero.
    for size in (np.ptp, lambda values, axis=-1: np.max(np.abs(values), axis=axis)):
        low, high = np.quantile(size(curves, axis=1), OUTER)
        found = float(size(measured))
        if low / BEYOND <= found <= high * BEYOND:
            return []
    unit = "" if each.response_unit == "1" else f" {each.response_unit}"
    return [
        f"{place}{each.response_name} reaches {found:.2g}{unit}, where the prior expects "
        f"{low:.2g} to {high:.2g}{unit} (90 %); are the units of record, specimen and priors right?"
    ]


def _off_its_zero(
    first: FloatArray, measured: FloatArray, each: Experiment, place: str
) -> list[str]:
    # A record begins where the model does: at rest, or after a share of its range if a step has
    # no rest before it.
    low, high = np.quantile(first, OUTER)
    reach = float(np.ptp(measured))
    if each.coordinate_name == "frequency" or low - reach <= measured[0] <= high + reach:
        return []
    name, unit = each.response_name, each.response_unit
    found, expected = (with_unit(v, unit, name, 3) for v in (measured[0], np.median(first)))
    return [
        f"{place}{name} begins at {found}, where the model has {expected}; what is it counted "
        "from? The step `baseline` takes the reading at rest for zero"
    ]


def overruled(
    study: Study, system: System, handed_on: Collection[str], theirs: Mapping[str, Settings]
) -> list[str]:
    """Warn of `priors:` entries for parameters whose prior `prior_from` provides.

    Such an entry is no prior but still bounds the inherited one. It must therefore equal the
    entry that the posterior was fitted with; only other entries are reported.

    Parameters
    ----------
    handed_on : names of the parameters that `prior_from` provides.
    theirs : `priors:` of the study that provides the posterior.
    """
    systems = (system, *wider_systems(study, system).values())
    parameters = tuple({p.name: p for each in systems for p in each.parameters()}.values())
    found = []
    for key, settings in study.priors.items():
        targets = targets_of(parameters, key, set(study.priors))
        names = [p.name for p in targets if p.name in handed_on]
        there = {key: theirs[key]} if key in theirs else {}
        if names and _read(parameters, {key: settings}) != _read(parameters, there):
            have = "have their priors" if names[1:] else "has its prior"
            found.append(
                f"priors.{key}: {', '.join(names)} {have} from {study.prior_from} (prior_from), "
                "not from this entry, which only bounds it and sets the scale on which its draws "
                "are taken over; give the entry that it was fitted with, or none"
            )
    return found


def _read(
    parameters: tuple[Parameter, ...], entries: Mapping[str, Settings]
) -> tuple[list[str], dict[str, float]] | None:
    """Describe every prior, and return minimum ratios; None if the entries are invalid here."""
    try:
        replaced, ratios = overridden(parameters, entries, entries)
    except UserError:
        return None
    return [each.prior.describe() for each in replaced], ratios
