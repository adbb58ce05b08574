"""Entries of `priors:` for parameters whose prior another posterior hands on (`prior_from`)."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from deabayes.faults import UserError
from deabayes.parameter import Parameter
from deabayes.predict_with import wider_systems
from deabayes.prior.overrides import overridden, targets_of
from deabayes.study import Settings, Study
from deabayes.systems import System


def overruled(
    study: Study, system: System, handed_on: Collection[str], theirs: Mapping[str, Settings]
) -> list[str]:
    """Warn of entries that are no prior, as one is handed on, and bound it otherwise than there.

    The entry that the posterior was fitted with is needed here, too: it bounds what is handed on.

    Parameters
    ----------
    handed_on : names of the parameters that `prior_from` hands on.
    theirs : `priors:` of the study whose posterior that is.
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
    """Every prior in words, and minimum ratios; None where the entries mean nothing here."""
    try:
        replaced, ratios = overridden(parameters, entries, entries)
    except UserError:
        return None
    return [each.prior.describe() for each in replaced], ratios
