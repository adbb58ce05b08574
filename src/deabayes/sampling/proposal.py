"""Frozen proposals: mixtures in straightened coordinates, beside a plain mixture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.mixture import Mixture, RandomSource, two_clusters
from deabayes.sampling.mixture import fit as fit_mixture
from deabayes.sampling.warp import Warp, fit_warp

FitWarp = Callable[[FloatArray], Warp | None]

STRAIGHTENED, PLAIN, COVERING = 0.95, 0.05, 0.1
FINE_COVERING = 0.2
SPLIT_GAIN = 0.1
"""Nats per held-out sample by which a split must describe them better."""
TRIAL_COMPONENTS = 4
MOST_TRIAL_SAMPLES = 5000


@dataclass(frozen=True)
class Part:
    """A mixture, in coordinates straightened by a map or in z itself."""

    weight: float
    mixture: Mixture
    warp: Warp | None = None

    def log_density(self, z: FloatArray) -> FloatArray:
        if self.warp is None:
            return self.mixture.log_density(z)
        x, log_jacobian = self.warp.straighten(z)
        return self.mixture.log_density(x) + log_jacobian

    def sample(self, rng: RandomSource, n: int) -> FloatArray:
        x = self.mixture.sample(rng, n)
        return x if self.warp is None else self.warp.inverse(x)


@dataclass(frozen=True)
class Proposal:
    """A density over z that can be sampled: the weighted sum of its parts.

    It is normalised where no part reaches beyond the prior's support; otherwise `sample` draws from
    what is inside, of which the density is `log_density` but for a constant.
    """

    parts: tuple[Part, ...]

    @property
    def dimension(self) -> int:
        return self.parts[0].mixture.dimension

    def log_density(self, z: FloatArray) -> FloatArray:
        """Normalised log density at z (W, d): (W,)."""
        z = np.atleast_2d(z)
        terms = np.stack([np.log(part.weight) + part.log_density(z) for part in self.parts])
        largest = terms.max(axis=0)
        return largest + np.log(np.exp(terms - largest).sum(axis=0))

    def sample(self, rng: RandomSource, n: int) -> FloatArray:
        """Draw n points (n, d), all inside the prior's support."""
        z = self._draw(rng, n)
        while (outside := np.isnan(z[:, 0])).any():
            z[outside] = self._draw(rng, int(outside.sum()))
        return z

    def _draw(self, rng: RandomSource, n: int) -> FloatArray:
        part = rng.choice(len(self.parts), size=n, p=[part.weight for part in self.parts])
        z = np.empty((n, self.dimension))
        for index, each in enumerate(self.parts):
            chosen = part == index
            z[chosen] = each.sample(rng, int(chosen.sum()))
        return z

    def arrays(self) -> dict[str, FloatArray]:
        """Everything needed to rebuild it with `from_arrays`, under flat names."""
        result = {"proposal_weights": np.array([part.weight for part in self.parts])}
        for index, part in enumerate(self.parts):
            warp = {} if part.warp is None else part.warp.arrays()
            for kind, arrays in (("mixture", part.mixture.arrays()), ("warp", warp)):
                result |= {f"proposal_{index}_{kind}_{name}": a for name, a in arrays.items()}
        return result

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, FloatArray], coordinates: Coordinates) -> Proposal:
        """Rebuild from `arrays()`; other names are ignored.

        Parameters
        ----------
        coordinates : in which its maps began; they are not among the arrays.
        """

        def under(prefix: str) -> dict[str, FloatArray]:
            return {n[len(prefix) :]: a for n, a in arrays.items() if n.startswith(prefix)}

        parts = []
        for index, weight in enumerate(np.atleast_1d(arrays["proposal_weights"])):
            warp = under(f"proposal_{index}_warp_")
            mixture = Mixture.from_arrays(under(f"proposal_{index}_mixture_"))
            straight = Warp.from_arrays(warp, coordinates) if warp else None
            parts.append(Part(float(weight), mixture, straight))
        return cls(tuple(parts))


def fit(
    samples: FloatArray,
    components: int,
    rng: np.random.Generator,
    log_density: FloatArray | None = None,
    may_split: bool = False,
    fine: bool = False,
    coordinates: Coordinates | None = None,
) -> Proposal:
    """Fit a proposal to samples (n, d) and freeze it.

    Most of it is a mixture in straightened coordinates, where the samples are many enough
    for that; a plain mixture stands by for where the polynomials do not reach.

    Parameters
    ----------
    log_density : of the target at the samples, up to a constant (n,). When given, a tenth
        of the proposal is fitted to the samples that the rest covers badly, resampled by
        the root of target over proposal: an independence sampler is slowed most by the few
        regions where that ratio is large. (By the ratio itself, a handful of samples would
        take it all.)
    may_split : samples of two modes, or of a bend too sharp for one map, may be parted,
        each part with its own, where that describes held-out samples better.
    coordinates : in which maps begin.
    """
    finite = np.isfinite(samples).all(axis=1)
    samples = samples[finite]
    fitted = partial(fit_warp, fine=fine, coordinates=coordinates or Coordinates())
    parts = _parts(samples, components, rng, fitted)
    if may_split and _better_split(samples, rng, fitted):
        parts = _split_parts(samples, components, rng, fitted)
    if log_density is not None:
        excess = log_density[finite] - Proposal(tuple(parts)).log_density(samples)
        weights = np.exp(0.5 * np.clip(excess - np.median(excess), -10.0, 10.0))
        chosen = rng.choice(len(samples), size=len(samples), p=weights / weights.sum())
        half = max(components // 2, 1)
        share = FINE_COVERING if fine else COVERING
        if fine:
            missed = _parts(samples[chosen], half, rng, fitted, share)
        else:
            missed = [Part(share, fit_mixture(samples[chosen], half, rng))]
        parts = [*(replace(part, weight=(1 - share) * part.weight) for part in parts), *missed]
    return Proposal(tuple(parts))


def _parts(
    samples: FloatArray,
    components: int,
    rng: np.random.Generator,
    fitted: FitWarp,
    weight: float = 1.0,
) -> list[Part]:
    """Parts of a total weight, fitted to samples (n, d): straightened and plain, or plain only."""
    plain = fit_mixture(samples, components, rng)
    warp = fitted(samples)
    if warp is None:
        return [Part(weight, plain)]
    straightened = fit_mixture(warp.forward(samples), components, rng)
    return [Part(weight * STRAIGHTENED, straightened, warp), Part(weight * PLAIN, plain)]


def _split_parts(
    samples: FloatArray, components: int, rng: np.random.Generator, fitted: FitWarp
) -> list[Part]:
    """Parts of each half of a split by size, or of the whole where there is none."""
    halves = two_clusters(samples, rng)
    parts: list[Part] = []
    for half in halves:
        share = len(half) / len(samples)
        own = max(1, round(components * max(share, 0.25)))
        parts += _parts(half, own, rng, fitted, share)
    return parts


def _better_split(samples: FloatArray, rng: np.random.Generator, fitted: FitWarp) -> bool:
    """Whether a split describes a held-out fifth of the samples better than none."""
    order = rng.permutation(len(samples))
    order = order[:MOST_TRIAL_SAMPLES]
    held_out, train = np.split(samples[order], [len(order) // 5])
    if len(two_clusters(train, rng)) < 2:
        return False
    whole = _parts(train, TRIAL_COMPONENTS, rng, fitted)
    split = _split_parts(train, TRIAL_COMPONENTS, rng, fitted)
    scores = [Proposal(tuple(parts)).log_density(held_out).mean() for parts in (whole, split)]
    return bool(scores[1] > scores[0] + SPLIT_GAIN)
