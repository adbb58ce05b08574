"""Export of a posterior as a prior for PyMC or NumPyro, in a Python module with its numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from deabayes.experiment import FloatArray
from deabayes.export.source import candidate_of, converged, provenance, title, units
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
    out_of_order: Mapping[tuple[str, ...], float]
    opposed: Mapping[tuple[str, str], float]


def prior_normal(tree: xr.DataTree) -> PriorNormal:
    """Fit a normal to the draws of the material and specimen parameters.

    The logarithm of a parameter is used if all draws are positive and, in addition, the prior's
    support is not negative or another parameter must have the same sign.

    Raises
    ------
    UserError : too few draws, or draws without spread.
    """
    names, draws = handed_on(tree)
    needed = FEWEST_DRAWS_PER_PARAMETER * len(names)
    if len(draws) < needed:
        raise UserError(
            f"the posterior has {len(draws)} draws, and a prior of {len(names)} correlated "
            f"parameters needs at least {needed}; fit again with more draws"
        )
    parameters = {p.name: p for p in candidate_of(tree).parameters()}
    pairs = [
        (name, other)
        for name, parameter in parameters.items()
        if (other := parameter.half_product_with) is not None and {name, other} <= set(names)
    ]
    signed = {name for name, p in parameters.items() if p.prior.support[0] < 0.0}
    signed -= {name for pair in pairs for name in pair}
    logarithm = tuple(
        bool(np.all(drawn > 0.0) and name not in signed)
        for name, drawn in zip(names, draws.T, strict=True)
    )
    values = np.where(logarithm, np.log(np.where(logarithm, draws, 1.0)), draws)
    mean, factor = values.mean(axis=0), _factor(names, values)
    white = np.linalg.solve(factor, (values - mean).T).T
    drawn = mean + np.random.default_rng(0).standard_normal((TRIED, len(mean))) @ factor.T
    columns = dict(zip(names, drawn.T, strict=True))
    positive = {name for name, is_log in zip(names, logarithm, strict=True) if is_log}
    return PriorNormal(
        tuple(names),
        tuple(units(tree)[name] for name in names),
        logarithm,
        mean,
        factor,
        distance_from_normal(white),
        _out_of_order(names, parameters, columns),
        {
            pair: _share_opposed(*pair, columns, positive)
            for pair in pairs
            if not positive.issuperset(pair)
        },
    )


def _factor(names: Sequence[str], values: FloatArray) -> FloatArray:
    """Cholesky factor of the draws' covariance, computed from their correlation.

    Raises
    ------
    UserError : all draws of a parameter are equal, or a parameter follows from others.
    """
    fixed = [name for name, drawn in zip(names, values.T, strict=True) if np.ptp(drawn) == 0.0]
    if fixed:
        raise UserError(
            f"all draws of {', '.join(fixed)} are equal, so they define no normal prior; fit again "
            "with more draws, or export with --to csv"
        )
    spread = values.std(axis=0, ddof=1)
    correlation = np.atleast_2d(np.cov(values / spread, rowvar=False))
    try:
        factor = np.asarray(np.linalg.cholesky(correlation), dtype=float)
    except np.linalg.LinAlgError:
        factor = np.zeros_like(correlation)
    if np.diag(factor).min() < LEAST_SPREAD:
        raise UserError(
            f"one of {', '.join(names)} follows from the others in all draws, so they define no "
            "normal prior; export with --to csv"
        )
    return spread[:, None] * factor


def _out_of_order(
    names: Sequence[str],
    parameters: Mapping[str, Parameter],
    columns: Mapping[str, FloatArray],
) -> dict[tuple[str, ...], float]:
    """Share of the normal's draws in which ordered parameters do not ascend, by group.

    Logarithms ascend if the parameters do.
    """
    groups: dict[str, list[str]] = {}
    for name in names:
        if name in parameters and parameters[name].ordered is not None:
            groups.setdefault(str(parameters[name].ordered), []).append(name)
    shares = {}
    for group in groups.values():
        if len(group) > 1:
            steps = np.diff([columns[name] for name in group], axis=0)
            shares[tuple(group)] = float(np.mean(np.any(steps <= 0.0, axis=0)))
    return shares


def _share_opposed(
    first: str, second: str, columns: Mapping[str, FloatArray], positive: set[str]
) -> float:
    """Share of the normal's draws in which the signs of two parameters differ."""
    signs = [
        np.ones(TRIED) if name in positive else np.sign(columns[name]) for name in (first, second)
    ]
    return float(np.mean(signs[0] != signs[1]))


def description(tree: xr.DataTree, normal: PriorNormal) -> list[str]:
    """Describe the prior: its origin, how well it fits, and what it does not preserve."""
    rough = normal.misfit > LARGEST_MISFIT
    sentences = [
        f"{title(tree)}, by deabayes {tree.attrs['deabayes_version']}.",
        f"{provenance(tree)}.",
        *([] if converged(tree) else ["The posterior has NOT CONVERGED: do not use this prior."]),
        f"Misfit {normal.misfit:.3f}, {'above' if rough else 'at most'} {LARGEST_MISFIT:g}: the "
        f"normal {'only approximates' if rough else 'describes'} the posterior. The misfit is the "
        "largest distance between distribution functions of draws and normal.",
    ]
    sentences += [
        f"{' < '.join(group)} holds in the posterior, but not in {100.0 * share:.2g} % of the "
        "normal's draws: add it as a constraint, or sort these parameters and their partners."
        for group, share in normal.out_of_order.items()
        if share > 0.0
    ]
    sentences += [
        f"{' and '.join(pair)} have the same sign in the posterior, but not in "
        f"{100.0 * share:.2g} % of the normal's draws: add it as a constraint."
        for pair, share in normal.opposed.items()
        if share > 0.0
    ]
    return sentences


def write_python(tree: xr.DataTree, path: Path, program: str, imports: str, prior: str) -> None:
    """Write a module with the normal's numbers and then `prior`, the text of a function."""
    normal = prior_normal(tree)
    sentences = "\n".join(description(tree, normal))
    labels = zip(normal.names, normal.units, strict=True)
    unit_lines = "".join(f"    {name!r}: {unit!r},\n" for name, unit in labels)
    rows = "".join(f"    {row},\n" for row in normal.factor.tolist())
    logarithms = [n for n, is_log in zip(normal.names, normal.logarithm, strict=True) if is_log]
    text = (
        f'"""Prior for {program}: a posterior as a multivariate normal.\n\n{sentences}\n"""\n\n'
        f"{imports}\n\n"
        f"UNITS = {{\n{unit_lines}}}\n"
        f"LOGARITHM = {logarithms!r}\n"
        "# Mean and Cholesky factor of the parameters, in the order of UNITS and in SI units.\n"
        "# Parameters in LOGARITHM are represented by their logarithms.\n"
        f"MEAN = np.array({normal.mean.tolist()!r})\n"
        f"CHOLESKY = np.array([\n{rows}])\n"
        f"MISFIT = {normal.misfit:.4g}\n\n\n{prior}"
    )
    path.write_text(text, encoding="utf-8")


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
    """Write `prior()` for the material and specimen parameters in PyMC; see `prior_normal`."""
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
    """Write `prior()` for the material and specimen parameters in NumPyro; see `prior_normal`."""
    write_python(tree, path, "NumPyro", NUMPYRO_IMPORTS, NUMPYRO_PRIOR)
