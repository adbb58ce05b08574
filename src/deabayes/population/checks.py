"""What is asked of a population, held against its studies before anything is run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from deabayes.distribution_settings import from_settings
from deabayes.faults import Faults, UserError, nearest
from deabayes.parameter import Parameter
from deabayes.population.settings import Population
from deabayes.prior import Prior
from deabayes.study import Study

FEWEST_SPECIMENS = 3
"""Of two, the spread would be its prior's."""


def check_population(population: Population, studies: Mapping[str, Study]) -> list[str]:
    """Faults of a population: too few specimens, one named twice, unknown names, bad priors.

    Parameters
    ----------
    studies : by name; the population's members are among them.
    """
    members = [studies[name] for name in population.studies]
    where = f"populations.{population.name}"
    faults = []
    if len(members) < FEWEST_SPECIMENS:
        faults.append(
            f"{where}, studies: {len(members)} specimens do not tell how specimens scatter; "
            f"name {FEWEST_SPECIMENS} or more"
        )
    seen: dict[object, str] = {}
    for study in members:
        specimen = study.specimen, tuple(sorted(study.select.items()))
        if specimen in seen:
            faults.append(
                f"{where}, studies: {seen[specimen]} and {study.name} are of one specimen "
                f"({study.specimen}), which would count twice; remove one"
            )
        seen.setdefault(specimen, study.name)
        if (study.prior_from or "").endswith(f"populations/{population.name}/posterior.nc"):
            faults.append(
                f"{where}, studies: {study.name} has this population for its prior, which would "
                "count its records twice; take it out of one"
            )
    without = [s for s in members if population.candidate not in s.candidates]
    if without:
        faults.append(
            f"{where}, candidate: among those of {', '.join(study.name for study in without)}: "
            f"there is no {population.candidate!r}"
            f"{nearest(population.candidate, without[0].candidates)}"
        )
    if members and not without:
        faults += _parameter_faults(population, members[0], where)
    return faults


def _parameter_faults(population: Population, study: Study, where: str) -> list[str]:
    """What is wrong with the names of parameters, and with the priors of their spread."""
    from deabayes.reading.specimen import read_specimen
    from deabayes.systems import build

    specimen = read_specimen(study.specimen)
    parameters = build(specimen.system, population.candidate, specimen).parameters()
    known = {parameter.name: parameter for parameter in parameters}
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
    return faults + _spread_faults(population, known, where)


def _spread_faults(population: Population, known: Mapping[str, Parameter], where: str) -> list[str]:
    faults = []
    for name, settings in population.spread.items():
        place = f"{where}, spread.{name}"
        if name not in population.parameters:
            faults.append(f"{place}: it is not among the parameters; add it there or remove it")
            continue
        try:
            unit = "1" if known[name].prior.support[0] >= 0.0 else known[name].unit
            prior = from_settings(settings, unit, place)
        except UserError as error:
            faults += str(error).splitlines()
            continue
        if prior.support[0] < 0.0:
            faults.append(f"{place}: a spread is not negative; give halfnormal, for example")
    return faults


def check_whole_groups(parameters: Sequence[Parameter], names: Sequence[str]) -> None:
    """Refuse a part of what has one joint prior: ordered groups, parts of a total, products.

    Raises
    ------
    Faults : one sentence per group.
    """
    faults = []
    for group in dict.fromkeys(p.ordered or p.part_of for p in parameters):
        members = [p.name for p in parameters if group and group in (p.ordered, p.part_of)]
        missing = [name for name in members if name not in names]
        if missing and len(missing) < len(members):
            faults.append(
                f"{', '.join(missing)} shares one joint prior ({group}) with the others of it "
                "named; add it, or name none of them"
            )
    for p in parameters:
        if p.name in names and p.half_product_with not in (None, *names):
            faults.append(f"{p.name} has its prior on a product; add {p.half_product_with}")
    if faults:
        raise Faults(faults)


def marginal(prior: Prior, names: Sequence[str]) -> Prior:
    """The prior of some of the parameters alone, the others integrated over.

    Blocks of the default prior are independent of each other, so those of the names are the
    marginal; an inherited normal's is the normal of its part, in the coordinate z of `names`,
    which depends on no other parameter.

    Raises
    ------
    Faults : a group with one joint prior is only partly named.
    """
    check_whole_groups(prior.parameters, names)
    kept = [p for p in prior.parameters if p.name in names]
    blocks = [b for block in prior.inherited if (b := block.of(names)) is not None]
    return Prior(kept, prior.minimum_ratios, blocks)
