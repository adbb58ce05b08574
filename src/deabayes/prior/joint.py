"""The joint prior of a candidate's parameters, standard normal in the coordinate z."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.prior.blocks import Block, DefaultMap
from deabayes.prior.distributions import format_number
from deabayes.prior.from_posterior import PosteriorBlock, PriorFromPosterior, check_scores
from deabayes.prior.learned import Shown
from deabayes.prior.ordered import Ordered
from deabayes.prior.overrides import check_same_order, overridden
from deabayes.prior.parameter import Parameter
from deabayes.prior.scores import log_normal_density

__all__ = ["Prior", "PriorFromPosterior"]
MINIMUM_RATIO = 2.0
CANDIDATES = 10
"""Number of candidates per draw, if draws are chosen by weight."""


class Prior:
    r"""Prior p(theta), given by a map theta = T(z) of z ~ N(0, I).

    Independent parameters have a quantile transform each. Members of an ordered group are order
    statistics with a minimum ratio (see `Ordered`). A half product of two parameters may have the
    prior (see `DefaultMap`), or the total of several parts (see `Parts`). Parameters inherited
    from another posterior are correlated (see `PosteriorBlock`).

    Parameters
    ----------
    parameters : in the order of theta's columns.
    minimum_ratio : smallest ratio of neighbours in ordered groups. A mapping gives the ratio by
        group; other groups have 2.
    inherited : joint priors that replace the default priors of the parameters they name.

    Attributes
    ----------
    parameters, names : in the order of theta's columns.
    """

    def __init__(
        self,
        parameters: Iterable[Parameter],
        minimum_ratio: float | Mapping[str, float] = MINIMUM_RATIO,
        inherited: Sequence[PosteriorBlock] = (),
    ) -> None:
        self.parameters = tuple(parameters)
        self.names = tuple(p.name for p in self.parameters)
        self.inherited = tuple(inherited)
        self._column = {name: k for k, name in enumerate(self.names)}
        if len(self._column) != len(self.names):
            repeated = sorted({n for n in self.names if self.names.count(n) > 1})
            raise ValueError(f"parameters named twice: {', '.join(repeated)}")
        self._members: dict[str, list[int]] = {}
        for k, parameter in enumerate(self.parameters):
            if parameter.ordered is not None:
                self._members.setdefault(parameter.ordered, []).append(k)
        given = minimum_ratio if isinstance(minimum_ratio, Mapping) else {}
        default = MINIMUM_RATIO if isinstance(minimum_ratio, Mapping) else minimum_ratio
        self.minimum_ratios = {group: given.get(group, default) for group in self._members}
        self._default = DefaultMap(self.parameters, self._members, self.minimum_ratios)
        self._inherited_columns = [[self._column[n] for n in b.names] for b in self.inherited]

    @classmethod
    def from_parameters(
        cls,
        parameters: Iterable[Parameter],
        overrides: Mapping[str, object] | None = None,
        also_known: Iterable[str] = (),
    ) -> Prior:
        """Return the default priors, replaced by those of the config where it sets any.

        Parameters
        ----------
        overrides : by parameter name, by ordered group (`tau_beta`, which may
            carry `minimum_ratio`), or by a noise parameter without its group
            (`sigma_ou`: in all groups).
        also_known : names of other candidates' parameters; their overrides are ignored.

        Raises
        ------
        UserError, Faults : unknown names, malformed priors, wrong units.
        """
        replaced, ratios = overridden(tuple(parameters), overrides or {}, also_known)
        return cls(replaced, ratios)

    @classmethod
    def concatenate(cls, *priors: Prior) -> Prior:
        """Join priors into one prior over all their parameters, in the given order."""
        ratios = {g: r for prior in priors for g, r in prior.minimum_ratios.items()}
        blocks = [block for prior in priors for block in prior.inherited]
        return cls((p for prior in priors for p in prior.parameters), ratios, blocks)

    def inherit(self, names: Sequence[str], draws: FloatArray) -> Prior:
        """Replace the priors of parameters by a fit to another posterior's draws.

        The fit is a multivariate normal in this prior's z. If one normal is not enough, it is a
        mixture of normals or a learned likelihood. The fit keeps correlations and supports; its
        misfit is in `inherited`. Parameters unknown here are marginalised.

        Parameters
        ----------
        draws : (S, k), SI, one column per name.

        Raises
        ------
        UserError : no common name, another model order, an incomplete ordered group or half
            product, or draws outside this prior's support or extremely far out.
        """
        common = tuple(n for n in self.names if n in names)
        check_same_order(self.parameters, names)
        theta = np.tile(
            self._default.to_parameters(np.zeros((1, len(self.names)))), (len(draws), 1)
        )
        for name in common:
            theta[:, self._column[name]] = draws[:, list(names).index(name)]
        columns = [self._column[n] for n in common]
        z = self._default.to_normal(theta)[:, columns]
        for name, column in zip(common, z.T, strict=True):
            check_scores(name, column, self.describe(name))

        def to_parameters(z: FloatArray) -> FloatArray:
            every = np.zeros((len(z), len(self.names)))
            every[:, columns] = z
            return self._default.to_parameters(every)[:, columns]

        shown = Shown.by([self.parameters[k] for k in columns])
        block = PosteriorBlock.fit(common, z, shown, to_parameters)
        kept = tuple(b for b in self.inherited if not set(b.names) & set(common))
        return Prior(self.parameters, self.minimum_ratios, (*kept, block))

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Blocks of parameters that are transformed together."""
        return self._default.blocks

    def to_parameters(self, z: FloatArray) -> FloatArray:
        """theta (W, d) of standard normal z (W, d)."""
        return self._default.to_parameters(self._mixed(z, "colour"))

    def to_normal(self, theta: FloatArray) -> FloatArray:
        """z (W, d) of theta (W, d); NaN where theta is outside the support."""
        return self._mixed(self._default.to_normal(theta), "whiten")

    def log_density(self, theta: FloatArray) -> FloatArray:
        """log p(theta), (W,), normalised; -inf outside the support."""
        theta = np.asarray(theta, dtype=float)
        total = self._default.log_density(theta)
        if self.inherited:
            z = self._default.to_normal(theta)
            total += self._over_inherited("log_density_ratio", theta, z)
        return np.where(np.isnan(total), -np.inf, total)

    def log_density_of_inherited(self, theta: FloatArray) -> FloatArray:
        """Log density (W,) of the default scores of the inherited parameters alone."""
        z = self._default.to_normal(theta)
        own = z[:, [column for columns in self._inherited_columns for column in columns]]
        default = np.sum(log_normal_density(own), axis=1)
        return default + self._over_inherited("log_density_ratio", theta, z)

    def log_correction(self, theta: FloatArray, z: FloatArray) -> FloatArray:
        """log p(theta) - log q(theta), (W,), q being the density of T(z), z ~ N(0, I): mostly 0.

        Far out it is a difference of large numbers, which rounded theta does not determine, so
        z is needed too.

        Parameters
        ----------
        z : (W, d), z of theta.
        """
        if self.is_normal_in_z:
            return np.zeros(len(theta))
        total = self._over_inherited("log_correction", theta, self._mixed(z, "colour"))
        return np.where(np.isnan(total), -np.inf, total)

    def sample(self, rng: np.random.Generator, n: int) -> FloatArray:
        """Independent draws theta (n, d); with a learned likelihood they are chosen by weight."""
        if self.is_normal_in_z:
            return self.to_parameters(rng.standard_normal((n, len(self.names))))
        learned = any(block.learned for block in self.inherited)
        z = rng.standard_normal((CANDIDATES * n if learned else n, len(self.names)))
        for block, columns in zip(self.inherited, self._inherited_columns, strict=True):
            z[:, columns] = block.mixture.sample(rng, len(z))
        theta = self._default.to_parameters(z)
        if not learned:
            return theta
        weights = np.nan_to_num(np.exp(self._over_inherited("log_weights", theta, z)))
        return theta[rng.choice(len(theta), size=n, p=weights / weights.sum())]

    @property
    def is_normal_in_z(self) -> bool:
        """Whether z ~ N(0, I) is exactly the prior: no mixture or likelihood is inherited."""
        return all(block.is_base for block in self.inherited)

    def _over_inherited(self, method: str, theta: FloatArray, z: FloatArray) -> FloatArray:
        """Sum of a method of the inherited blocks at their columns of theta and z, (W,)."""
        total = np.zeros(len(theta))
        for block, columns in zip(self.inherited, self._inherited_columns, strict=True):
            total += getattr(block, method)(theta[:, columns], z[:, columns])
        return total

    @property
    def scored_alone(self) -> frozenset[str]:
        """Names of parameters whose z does not depend on other parameters.

        Parts of a total, members of an ordered group, parameters with a half product and
        inherited parameters are left out: their z may depend on others.
        """
        together = {n for block in self.inherited for n in block.names}
        for group in self._members.values():
            together.update(self.names[k] for k in group if len(group) > 1)
        for parameter in self.parameters:
            if parameter.part_of is not None or parameter.half_product_with is not None:
                together.add(parameter.name)
        return frozenset(self.names) - together

    def describe(self, name: str) -> str:
        """The prior of one parameter in words, for tables."""
        parameter = self.parameters[self._column[name]]
        text = parameter.prior.describe()
        if parameter.part_of is not None:
            text = f"a part of {parameter.part_of}, uniform on the simplex: {text}"
        elif parameter.half_product_with is not None:
            text = f"half of {name} {parameter.half_product_with}: {text}"
        if parameter.ordered is not None and len(self._members[parameter.ordered]) > 1:
            ratio = self.minimum_ratios[parameter.ordered]
            block = next(b for b in self.blocks if self._column[name] in b.columns)
            apart = isinstance(block, Ordered) and block.factors[-1] > 1.0
            spacing = f" at least a factor {format_number(ratio)} apart" if apart else ""
            text = f"{text}, ascending{spacing} ({parameter.ordered})"
        for inherited in self.inherited:
            if name in inherited.names:
                text = f"{inherited.describe()} of: {text}; misfit {inherited.misfit:.3f}"
        return text

    def _mixed(self, z: FloatArray, method: str) -> FloatArray:
        """z with `colour` or `whiten` applied to the inherited columns."""
        if not self.inherited:
            return np.asarray(z, dtype=float)
        z = np.array(z, dtype=float)
        for block, columns in zip(self.inherited, self._inherited_columns, strict=True):
            z[:, columns] = getattr(block.base, method)(z[:, columns])
        return z
