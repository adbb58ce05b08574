"""Priors from config entries: find the parameters of an entry and check its units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, fields, replace
from statistics import NormalDist
from typing import Any

from deabayes.faults import Faults, UserError, nearest
from deabayes.prior.distributions import REGISTRY, Distribution, LogNormal, LogUniform, Uniform
from deabayes.prior.parameter import Parameter
from deabayes.quantities import taken_in_si
from deabayes.units import parse_quantity


def from_settings(settings: Mapping[str, object], unit: str, where: str) -> Distribution:
    """A distribution from a config entry, with its units checked.

    Parameters
    ----------
    settings : ``{"distribution": "lognormal", "median": "35 kPa", "sigma": 0.5}``;
        numbers are in SI units, texts include their unit.
    unit : SI unit of the quantity.
    where : file and key, for the message.

    Raises
    ------
    UserError : unknown distribution or setting, a missing one, a wrong unit, or
        invalid values.
    """
    if not isinstance(settings, Mapping):
        raise UserError(
            f"{where}: expected a mapping such as "
            f"{{distribution: lognormal, median: 1, sigma: 0.5}}, found {settings!r}"
        )
    name = settings.get("distribution")
    if name not in REGISTRY:
        hint = nearest(str(name), REGISTRY)
        raise UserError(f"{where}: unknown distribution {name!r}{hint}")
    kind = REGISTRY[str(name)]
    values = {key: value for key, value in settings.items() if key != "distribution"}
    _check_keys(kind, str(name), values, where)
    numbers = {
        key: _number(value, "1" if key in kind.dimensionless else unit, f"{where}.{key}")
        for key, value in values.items()
    }
    try:
        return kind(**numbers)
    except ValueError as error:
        raise UserError(f"{where}: {error}") from None


def settings_without_unit(settings: Mapping[str, object]) -> list[str]:
    """Names of settings that need a unit but are plain numbers; a zero needs no unit."""
    kind = REGISTRY.get(str(settings.get("distribution")))
    plain = {"distribution", "minimum_ratio", *(kind.dimensionless if kind else settings)}
    return [key for key, value in settings.items() if key not in plain and _is_plain(value)]


def _is_plain(value: object) -> bool:
    try:
        return not isinstance(value, bool) and bool(float(value))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return False


def _check_keys(
    kind: type[Distribution], name: str, values: Mapping[str, object], where: str
) -> None:
    known = {field.name: field for field in fields(kind)}  # type: ignore[arg-type]
    for key in values:
        if key not in known:
            raise UserError(f"{where}: {name} has no setting {key!r}{nearest(key, known)}")
    missing = [k for k, f in known.items() if k not in values and f.default is MISSING]
    if missing:
        names = " and ".join(missing)
        raise UserError(f"{where}: {name} has no {names}; add {names}")


def _number(value: object, unit: str, where: str) -> float:
    """Return a number unchanged, or convert a text such as ``35 kPa`` to SI units."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, str):
        raise UserError(f"{where}: expected a number or a text such as '2 {unit}', found {value!r}")
    try:
        return float(value)
    except ValueError:
        return float(parse_quantity(value, unit, where))


LARGEST_SHARE_BELOW_ZERO = 1e-3
NUMBERED = re.compile(r"(.*_)(\d+)")


def overridden(
    parameters: tuple[Parameter, ...], overrides: Mapping[str, object], also_known: Iterable[str]
) -> tuple[tuple[Parameter, ...], dict[str, float]]:
    """Return parameters with the config's priors, and the config's minimum ratios by group.

    Raises
    ------
    Faults : all errors in `overrides` together.
    """
    replaced = {p.name: p for p in parameters}
    ratios: dict[str, float] = {}
    faults: list[str] = []
    passed_over = set(also_known)
    for key, settings in overrides.items():
        try:
            targets = targets_of(parameters, key, passed_over)
            settings, ratio = _split_ratio(settings, key, targets)
            if ratio is not None:
                ratios[key] = ratio
            only_ratio = ratio is not None and not settings
            for target in () if only_ratio else targets:
                prior = _prior_of(target, settings, f"priors.{key}")
                _check_support(prior, target, f"priors.{key}")
                replaced[target.name] = replace(target, prior=prior, source="config")
            if ratio is not None and targets:
                _check_ratio(ratio, replaced[targets[0].name].prior, key)
        except UserError as fault:
            faults.append(str(fault))
    if faults:
        raise Faults(faults)
    return tuple(replaced.values()), ratios


def _prior_of(parameter: Parameter, settings: Mapping[str, object], where: str) -> Distribution:
    """The config's prior of a parameter; a message on a plain number says what the number is."""
    try:
        return from_settings(settings, parameter.unit, where)
    except UserError as fault:
        if parameter.unit != "1":
            raise
        text = f"{fault}. {parameter.name} is the {parameter.description}"
        raise UserError(text) from None


def bare_numbers(
    parameters: tuple[Parameter, ...], overrides: Mapping[str, object], also_known: Iterable[str]
) -> list[str]:
    """Cautions for numbers without a unit, for parameters with a unit, in valid overrides."""
    cautions = []
    for key, settings in overrides.items():
        targets = targets_of(parameters, key, set(also_known))
        if not targets or targets[0].unit == "1" or not isinstance(settings, Mapping):
            continue
        cautions += [
            taken_in_si(settings[name], targets[0].unit, f"priors.{key}.{name}")
            for name in settings_without_unit(settings)
        ]
    return cautions


def check_same_order(parameters: tuple[Parameter, ...], names: Sequence[str]) -> None:
    """Refuse a posterior whose model order differs, or that splits an ordered group.

    Raises
    ------
    UserError
    """
    here = {p.name for p in parameters}
    if not here & set(names):
        raise UserError(
            f"prior_from: this candidate has none of the posterior's parameters "
            f"({', '.join(names)}); take the posterior of a similar candidate"
        )
    for name in names:
        if name not in here and _stem(name) in {_stem(n) for n in here} - {None}:
            raise UserError(
                f"prior_from: the posterior has {name}, which this candidate lacks; take the "
                "posterior of a candidate of the same order"
            )
    for parameter in parameters:
        group = [p.name for p in parameters if parameter.ordered and p.ordered == parameter.ordered]
        missing = [n for n in group if n not in names]
        if missing and len(missing) < len(group):
            raise UserError(
                f"prior_from: the posterior lacks {', '.join(missing)} of the ordered "
                f"{parameter.ordered}; take the posterior of a candidate of the same order"
            )
        other = parameter.half_product_with
        if parameter.name in names and other and other not in names:
            raise UserError(
                f"prior_from: the posterior has {parameter.name} without {other}, but the prior "
                "is on their product; keep both"
            )


def targets_of(
    parameters: tuple[Parameter, ...], key: str, passed_over: set[str]
) -> list[Parameter]:
    """Return the parameters that `key` names; none if `key` belongs to another candidate."""
    named = [p for p in parameters if p.name == key]
    if named and named[0].ordered is not None:
        raise UserError(
            f"priors.{key}: the members of {named[0].ordered} share one prior, since they are "
            f"ordered; set priors.{named[0].ordered}"
        )
    if named and named[0].part_of is not None:
        raise UserError(
            f"priors.{key}: the prior is on the total {named[0].part_of}, of which {key} is a "
            f"part; set priors.{named[0].part_of}"
        )
    group = [p for p in parameters if key in (p.ordered, p.part_of)]
    suffixed = [p for p in parameters if p.name.endswith(f".{key}")]
    if targets := named or group or suffixed:
        return targets
    if key in passed_over:
        return []
    known = [p.ordered or p.part_of or p.name for p in parameters]
    raise UserError(f"priors.{key}: no parameter has this name{nearest(key, dict.fromkeys(known))}")


def _check_support(prior: Distribution, parameter: Parameter, where: str) -> None:
    """Refuse a prior that reaches below zero for a parameter that must be positive.

    A thin tail below zero is harmless: its draws fail and are counted.
    """
    default = parameter.prior
    positive = default.support[0] >= 0.0 and not isinstance(default, Uniform)
    if not positive or prior.support[0] >= 0.0 or parameter.half_product_with is not None:
        return
    below = 1.0 if prior.support[1] <= 0.0 else NormalDist().cdf(float(prior.to_normal(0.0)))
    if below > LARGEST_SHARE_BELOW_ZERO:
        raise UserError(
            f"{where}: {parameter.name} must be positive, but {100 * below:.3g} % of the prior "
            "lies below 0; use lognormal, halfnormal, or truncated_normal with lower: 0"
        )


def _split_ratio(settings: object, key: str, targets: list[Parameter]) -> tuple[Any, float | None]:
    """Split off `minimum_ratio`, which only an ordered group may have, from the settings."""
    if not isinstance(settings, Mapping) or "minimum_ratio" not in settings:
        return settings, None
    if any(p.ordered != key for p in targets):
        raise UserError(f"priors.{key}: minimum_ratio is for ordered groups; remove it")
    ratio = settings["minimum_ratio"]
    if isinstance(ratio, bool) or not isinstance(ratio, int | float) or not ratio >= 1.0:
        raise UserError(f"priors.{key}.minimum_ratio: expected a number from 1, found {ratio!r}")
    return {k: v for k, v in settings.items() if k != "minimum_ratio"}, float(ratio)


def _stem(name: str) -> str | None:
    """``mu_beta_`` of ``mu_beta_3``; None for a name without a number."""
    match = NUMBERED.fullmatch(name)
    return match.group(1) if match else None


def _check_ratio(ratio: float, prior: Distribution, key: str) -> None:
    """Refuse a minimum ratio for priors other than log-uniform and log-normal."""
    if ratio > 1.0 and not isinstance(prior, LogUniform | LogNormal):
        raise UserError(
            f"priors.{key}: minimum_ratio {ratio:g} needs a loguniform or lognormal prior, but "
            f"the prior is {prior.describe()}; change the distribution, or remove minimum_ratio"
        )
