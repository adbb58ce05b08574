"""What predicts held-out records beyond the fitted candidate: `predict_with` of a study."""

from __future__ import annotations

from collections.abc import Sequence

from deabayes.experiment import Specimen
from deabayes.prior.joint import Prior, PriorFromPosterior
from deabayes.study import Study
from deabayes.systems import build as build_system
from deabayes.systems.base import System


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

    No fitted record tells anything of them: their posterior is this.

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
    known = (*fitted, *names_of_all(study, system.specimen))
    prior = Prior.from_parameters(further.values(), study.priors, known)
    if inherited is not None and set(inherited.names) & set(prior.names):
        prior = prior.inherit(*inherited)
    return prior


def only_for_predictions(
    inherited: PriorFromPosterior, prior: Prior, study: Study, specimen: Specimen
) -> bool:
    """Whether `prior_from` holds parameters of what `predict_with` adds, and none of the fit's."""
    names = set(inherited.names)
    further = set(names_of_all(study, specimen)) if study.predict_with else set()
    return not names & set(prior.names) and bool(names & further)


def names_of_all(study: Study, specimen: Specimen) -> tuple[str, ...]:
    """Parameters of all candidates, and of what predicts with them."""
    return tuple(
        parameter.name
        for candidate in study.candidates
        for ending in ("", *study.predict_with.values())
        for parameter in build_system(specimen.system, candidate + ending, specimen).parameters()
    )
