"""Check a population's settings against its studies before anything runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from deabayes.faults import Faults, UserError, nearest
from deabayes.population.coordinate import Coordinate
from deabayes.population.settings import Population
from deabayes.prior.joint import Prior
from deabayes.prior.overrides import from_settings, settings_without_unit
from deabayes.prior.parameter import Parameter
from deabayes.study import Study

FEWEST_SPECIMENS = 3
"""With two specimens, the prior alone would determine the spread."""


def check_population(population: Population, studies: Mapping[str, Study]) -> list[str]:
    """List a population's faults: too few or repeated specimens, unknown names, bad priors.

    Parameters
    ----------
    studies : studies by name, including the population's members.
    """
    members = [studies[name] for name in population.studies]
    where = f"populations.{population.name}"
    faults = []
    if len(members) < FEWEST_SPECIMENS:
        faults.append(
            f"{where}, studies: {len(members)} specimens are too few to estimate their spread; "
            f"name {FEWEST_SPECIMENS} or more"
        )
    seen: dict[object, str] = {}
    for study in members:
        specimen = study.specimen, tuple(sorted(study.select.items()))
        if specimen in seen:
            faults.append(
                f"{where}, studies: {seen[specimen]} and {study.name} have the same specimen "
                f"({study.specimen}), which would count twice; remove one"
            )
        seen.setdefault(specimen, study.name)
        if (study.prior_from or "").endswith(f"populations/{population.name}/posterior.nc"):
            faults.append(
                f"{where}, studies: {study.name} has this population as its prior, which would "
                "count its records twice; remove the study here, or its `prior_from`"
            )
    without = [s for s in members if population.candidate not in s.candidates]
    if without:
        faults.append(
            f"{where}, candidate: no {population.candidate!r} in "
            f"{', '.join(study.name for study in without)}"
            f"{nearest(population.candidate, without[0].candidates)}"
        )
    if members and not without:
        faults += _parameter_faults(population, members, where)
    return faults


def _parameter_faults(population: Population, members: Sequence[Study], where: str) -> list[str]:
    """List the faults in the names of parameters and in the priors of their spread."""
    try:
        coordinates = {s.name: _coordinate(s, population.candidate) for s in members}
    except UserError as error:
        return [f"{where}, {fault}" for fault in str(error).splitlines()]
    coordinate = coordinates[members[0].name]
    parameters, known = coordinate.parameters, coordinate.names
    faults = []
    for name in population.parameters:
        if name in known:
            continue
        noise = "." in name or name.startswith(("sigma_", "tau_ou"))
        why = (
            "noise belongs to a record, not to the material; remove it"
            if noise
            else f"{population.candidate} has no such parameter{nearest(name, known)}"
        )
        faults.append(f"{where}, parameters: {name!r}: {why}")
    if faults:
        return faults
    try:
        check_whole_groups(parameters, population.parameters)
    except UserError as error:
        faults += [f"{where}, parameters: {fault}" for fault in str(error).splitlines()]
    faults += _sign_faults(population, coordinates, where)
    return faults + _spread_faults(population, coordinate, where)


def _coordinate(study: Study, candidate: str) -> Coordinate:
    """Return the coordinate of all parameters of a candidate, with the study's priors."""
    from deabayes.records.specimen import read_specimen
    from deabayes.systems import build

    specimen = read_specimen(study.specimen)
    parameters = build(specimen.system, candidate, specimen).parameters()
    # Priors of noise and of other candidates are in the settings too.
    prior = Prior.from_parameters(parameters, study.priors, also_known=study.priors)
    return Coordinate.of(prior.parameters)


def _sign_faults(
    population: Population, coordinates: Mapping[str, Coordinate], where: str
) -> list[str]:
    """List parameters that are positive under one study's priors but not under another's."""
    signed: dict[str, list[str]] = {}
    for study, coordinate in coordinates.items():
        for name, logarithmic in zip(coordinate.names, coordinate.logarithmic, strict=True):
            if name in population.parameters and not logarithmic:
                signed.setdefault(name, []).append(study)
    return [
        f"{where}, parameters: {name} can be negative in {', '.join(studies)} but not in "
        f"{', '.join(s for s in coordinates if s not in studies)}; give it priors of one sign"
        for name, studies in signed.items()
        if len(studies) < len(coordinates)
    ]


def _spread_faults(population: Population, coordinate: Coordinate, where: str) -> list[str]:
    units = dict(zip(coordinate.names, coordinate.spread_units, strict=True))
    faults = []
    for name, settings in population.spread.items():
        place = f"{where}, spread.{name}"
        if name not in population.parameters:
            faults.append(
                f"{place}: {name} is not under `parameters`; add it there, or remove it here"
            )
            continue
        try:
            prior = from_settings(settings, units[name], place)
        except UserError as error:
            faults += str(error).splitlines()
            continue
        if prior.support[0] < 0.0:
            faults.append(
                f"{place}: a spread is not negative, but this prior reaches below 0; "
                "use halfnormal, for example"
            )
        if units[name] != "1" and settings_without_unit(settings):
            faults.append(
                f"{place}: {name} can be negative, so its spread is absolute, in "
                f"{units[name]}; write the unit, such as '2 {units[name]}'"
            )
    return faults


def check_whole_groups(parameters: Sequence[Parameter], names: Sequence[str]) -> None:
    """Check that groups with a joint prior (ordered, total, product) are named completely.

    Raises
    ------
    Faults : one sentence per incomplete group.
    """
    faults = []
    for group in dict.fromkeys(p.ordered or p.part_of for p in parameters):
        members = [p.name for p in parameters if group and group in (p.ordered, p.part_of)]
        missing = [name for name in members if name not in names]
        if missing and len(missing) < len(members):
            faults.append(
                f"{', '.join(missing)} shares one joint prior ({group}) with parameters that are "
                "named; name all of them, or none"
            )
    for p in parameters:
        if p.name in names and p.half_product_with not in (None, *names):
            faults.append(
                f"{p.name} has its prior on its product with {p.half_product_with}; "
                f"add {p.half_product_with}"
            )
    if faults:
        raise Faults(faults)


def marginal(prior: Prior, names: Sequence[str]) -> Prior:
    """Return the marginal prior of some of the parameters.

    Blocks of the default prior are independent, so the blocks of `names` are the marginal. The
    marginal of an inherited mixture is the mixture of its part in the coordinate z of `names`,
    which depends on no other parameter.

    Raises
    ------
    Faults : `names` contains only a part of a group with a joint prior.
    """
    check_whole_groups(prior.parameters, names)
    kept = [p for p in prior.parameters if p.name in names]
    blocks = [b for block in prior.inherited if (b := block.of(names)) is not None]
    return Prior(kept, prior.minimum_ratios, blocks)
