"""Export of a posterior as a prior for PyMC or NumPyro, in a Python module with its numbers."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import xarray as xr

from deabayes.experiment import FloatArray
from deabayes.export.taken import candidate_of, whose
from deabayes.faults import UserError
from deabayes.posteriors.inheritance import handed_on
from deabayes.prior.from_posterior import FEWEST_DRAWS_PER_PARAMETER, LARGEST_MISFIT
from deabayes.prior.learned import distance_from_normal
from deabayes.prior.parameter import Parameter

LEAST_SPREAD = 1e-6
"""Smallest spread of a parameter given the parameters before it, as a share of its full spread.
Smaller values are rounding errors."""
TRIED = 20_000
"""Number of draws of the normal for checking order and signs of parameters."""


@dataclass(frozen=True)
class PriorNormal:
    """N(mean, factor factor^T) of the parameters, or of their logarithms where `logarithm`.

    Attributes
    ----------
    misfit : largest distance between distribution functions of posterior draws and normal
        (`prior.learned.distance_from_normal` of the whitened draws).
    out_of_order : share of the normal's draws in which ordered parameters do not ascend, by group
        of names.
    opposed : share of the normal's draws in which two parameters have different signs although
        the posterior gives them the same sign, by pair.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    logarithm: tuple[bool, ...]
    mean: FloatArray
    factor: FloatArray
    misfit: float
    out_of_order: tuple[tuple[tuple[str, ...], float], ...]
    opposed: tuple[tuple[tuple[str, str], float], ...]


def prior_normal(tree: xr.DataTree) -> PriorNormal:
    """Fit a normal to the draws of the material and specimen parameters.

    The logarithm of a parameter is used if all draws are positive and, in addition, the prior's
    support is not negative or another parameter must have the same sign.

    Raises
    ------
    UserError : too few draws, or draws without spread.
    """
    names, draws = handed_on(tree)
    if len(draws) < FEWEST_DRAWS_PER_PARAMETER * len(names):
        raise UserError(
            f"{len(draws)} draws cannot carry the correlations of {len(names)} parameters; a "
            f"posterior needs at least {FEWEST_DRAWS_PER_PARAMETER * len(names)} to become a prior"
        )
    parameters = {p.name: p for p in candidate_of(tree).parameters()}
    pairs = _of_one_sign(names, parameters)
    signed = {name for name, p in parameters.items() if p.prior.support[0] < 0.0}
    signed -= {name for pair in pairs for name in pair}
    logarithm = tuple(
        bool(np.all(drawn > 0.0) and name not in signed)
        for name, drawn in zip(names, draws.T, strict=True)
    )
    values = np.where(logarithm, np.log(np.where(logarithm, draws, 1.0)), draws)
    mean, factor = values.mean(axis=0), _factor(names, values)
    white = np.linalg.solve(factor, (values - mean).T).T
    units = tuple(str(tree["posterior"][name].attrs.get("unit", "1")) for name in names)
    columns = _drawn(names, mean, factor)
    disorder = _out_of_order(_ordered(names, parameters), columns)
    positive = {name for name, of in zip(names, logarithm, strict=True) if of}
    opposed = _opposed([pair for pair in pairs if not positive.issuperset(pair)], positive, columns)
    misfit = distance_from_normal(white)
    return PriorNormal(names, units, logarithm, mean, factor, misfit, disorder, opposed)


def _factor(names: Sequence[str], values: FloatArray) -> FloatArray:
    """Cholesky factor of the draws' covariance, computed from their correlation.

    Raises
    ------
    UserError : all draws of a parameter are equal, or a parameter follows from others.
    """
    fixed = [name for name, drawn in zip(names, values.T, strict=True) if np.ptp(drawn) == 0.0]
    if fixed:
        raise UserError(
            f"all draws of {', '.join(fixed)} are alike, so they make no normal prior; fit again "
            "with more draws, or export to csv"
        )
    spread = values.std(axis=0, ddof=1)
    correlation = np.atleast_2d(np.cov(values / spread, rowvar=False))
    try:
        factor = np.asarray(np.linalg.cholesky(correlation), dtype=float)
    except np.linalg.LinAlgError:
        factor = np.zeros_like(correlation)
    if np.diag(factor).min() < LEAST_SPREAD:
        raise UserError(
            f"draws of {', '.join(names)} do not vary in every direction: one follows from the "
            "others, so they make no normal prior; export to csv"
        )
    return spread[:, None] * factor


def _ordered(names: Sequence[str], parameters: dict[str, Parameter]) -> tuple[tuple[str, ...], ...]:
    """Names of ordered parameters, by group."""
    groups: dict[str, list[str]] = {}
    for name in names:
        if name in parameters and parameters[name].ordered is not None:
            groups.setdefault(str(parameters[name].ordered), []).append(name)
    return tuple(tuple(group) for group in groups.values() if len(group) > 1)


def _of_one_sign(
    names: Sequence[str], parameters: dict[str, Parameter]
) -> tuple[tuple[str, str], ...]:
    """Pairs of parameters whose product is positive, so that they have the same sign."""
    return tuple(
        (name, other)
        for name, parameter in parameters.items()
        if (other := parameter.half_product_with) is not None and {name, other} <= set(names)
    )


def _drawn(names: Sequence[str], mean: FloatArray, factor: FloatArray) -> dict[str, FloatArray]:
    """Draws of the normal by name, with logarithms where the normal uses them."""
    drawn = mean + np.random.default_rng(0).standard_normal((TRIED, len(mean))) @ factor.T
    return {name: drawn[:, k] for k, name in enumerate(names)}


def _opposed(
    pairs: Sequence[tuple[str, str]], positive: Collection[str], columns: dict[str, FloatArray]
) -> tuple[tuple[tuple[str, str], float], ...]:
    """Share of the normal's draws in which the signs of a pair differ, by pair."""
    signs = {n: np.ones(len(v)) if n in positive else np.sign(v) for n, v in columns.items()}
    return tuple(((a, b), float(np.mean(signs[a] != signs[b]))) for a, b in pairs)


def _out_of_order(
    groups: Sequence[tuple[str, ...]], columns: dict[str, FloatArray]
) -> tuple[tuple[tuple[str, ...], float], ...]:
    """Share of the normal's draws in which a group does not ascend, by group.

    Logarithms ascend if the parameters do.
    """
    found = []
    for group in groups:
        wrong = [columns[one] >= columns[next_one] for one, next_one in pairwise(group)]
        found.append((group, float(np.mean(np.any(wrong, axis=0)))))
    return tuple(found)


def in_words(tree: xr.DataTree, normal: PriorNormal) -> list[str]:
    """Describe the prior: its origin, how well it fits, and what it does not preserve."""
    attrs = tree.attrs
    simulated = attrs["provenance"] == "simulated"
    said = [
        f"{attrs['candidate']} of system {attrs['system']}, {whose(tree)}, by deabayes "
        f"{attrs['deabayes_version']}.",
        "From SIMULATED records, not measurements."
        if simulated
        else f"Provenance: {attrs['provenance']}.",
    ]
    if not json.loads(attrs["convergence"])["converged"]:
        said.append("The posterior has NOT CONVERGED: do not use it.")
    rough = normal.misfit > LARGEST_MISFIT
    said.append(
        f"Misfit {normal.misfit:.3f}, the largest distance of distribution functions between draws "
        f"and normal: {'above' if rough else 'up to'} {LARGEST_MISFIT:g}, the normal "
        f"{'only approximates' if rough else 'describes'} the posterior."
    )
    said += [
        f"In {100.0 * share:.2g} % of its draws {' < '.join(group)} does not hold, which it does "
        "in the posterior: constrain it, or sort them with what belongs to them."
        for group, share in normal.out_of_order
        if share > 0.0
    ]
    said += [
        f"In {100.0 * share:.2g} % of its draws the signs of {' and '.join(pair)} differ, which "
        "they never do in the posterior: constrain them."
        for pair, share in normal.opposed
        if share > 0.0
    ]
    return said


def write_python(tree: xr.DataTree, path: Path, program: str, imports: str, prior: str) -> None:
    """Write a module with the normal's numbers and then `prior`, the text of a function."""
    normal = prior_normal(tree)
    said = "\n".join(in_words(tree, normal))
    names = "".join(f"    {name!r}: {unit!r},\n" for name, unit in _units(normal))
    rows = "".join(f"    {row},\n" for row in normal.factor.tolist())
    text = (
        f'"""Prior for {program}: a posterior as a multivariate normal.\n\n{said}\n"""\n\n'
        f"{imports}\n\n"
        f"UNITS = {{\n{names}}}\n"
        "LOGARITHM = "
        f"{[name for name, of in zip(normal.names, normal.logarithm, strict=True) if of]!r}\n"
        "# Of the logarithms of those in LOGARITHM and of the others' values, in the order of "
        "UNITS, SI.\n"
        f"MEAN = np.array({normal.mean.tolist()!r})\n"
        f"CHOLESKY = np.array([\n{rows}])\n"
        f"MISFIT = {normal.misfit:.4g}\n\n\n{prior}"
    )
    path.write_text(text, encoding="utf-8")


def _units(normal: PriorNormal) -> list[tuple[str, str]]:
    return list(zip(normal.names, normal.units, strict=True))


PYMC_IMPORTS = "import numpy as np\nimport pymc as pm"
PYMC_PRIOR = '''\
def prior():
    """Define the parameters inside a model (`with pm.Model(): theta = prior()`).

    Returns a dictionary, name -> variable, SI.
    """
    drawn = pm.MvNormal("deabayes_transformed", mu=MEAN, chol=CHOLESKY, shape=len(UNITS))
    return {
        name: pm.Deterministic(name, pm.math.exp(drawn[k]) if name in LOGARITHM else drawn[k])
        for k, name in enumerate(UNITS)
    }
'''


def write_pymc(tree: xr.DataTree, path: Path) -> None:
    """Write `prior()` for the material and specimen parameters in PyMC; see `prior_normal`.

    Raises
    ------
    UserError : too few draws, or draws without spread.
    """
    write_python(tree, path, "PyMC", PYMC_IMPORTS, PYMC_PRIOR)


NUMPYRO_IMPORTS = (
    "import jax.numpy as jnp\nimport numpy as np\nimport numpyro\nfrom numpyro import distributions"
)
NUMPYRO_PRIOR = '''\
def prior():
    """Define the parameters inside a model (`theta = prior()`).

    Returns a dictionary, name -> value, SI. `numpyro.enable_x64()` first keeps all digits.
    """
    normal = distributions.MultivariateNormal(loc=MEAN, scale_tril=CHOLESKY)
    drawn = numpyro.sample("deabayes_transformed", normal)
    return {
        name: numpyro.deterministic(name, jnp.exp(drawn[k]) if name in LOGARITHM else drawn[k])
        for k, name in enumerate(UNITS)
    }
'''


def write_numpyro(tree: xr.DataTree, path: Path) -> None:
    """Write `prior()` for the material and specimen parameters in NumPyro; see `prior_normal`.

    Raises
    ------
    UserError : too few draws, or draws without spread.
    """
    write_python(tree, path, "NumPyro", NUMPYRO_IMPORTS, NUMPYRO_PRIOR)
