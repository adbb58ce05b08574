"""How much of a specimen's last unit its records can show at all.

D is the least Kullback-Leibler divergence, in nats, of the distribution of the specimen's records
from those that fewer units can make of them, with noise of any size. With r the difference of the
two curves, C the covariance of the true noise and C' that of the other noise (both with the
smooth error's, if there is one), the divergence is

    (r' C'^-1 r + tr(C'^-1 C) - N + ln |C'| - ln |C|) / 2.

D is the logarithm of the likelihood ratio that records of this specimen have on average; its sd is
about sqrt(2 D). It depends on the truth and not on the noise that happened to be added. It can
therefore sort specimens without looking at what was decided. Noise has to be free: nobody knows
its size beforehand, and larger correlated noise explains most of a curve that is a little off.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from deabayes.experiment import Experiment, FloatArray
from deabayes.inference.log_posterior import LogPosterior
from tests.validation.worlds import SmoothIn, World, error_covariance

TRIED, CLIMBED = 1000, 6
FURTHEST = 6.0
STEP = 1e-4
FAILED = 1e4
"""A residual in noise sds where a curve does not exist."""
SHOWN = 17.0
"""Nats from which on a unit counts as shown: D - 2 sqrt(2 D) > 4, so that in 39 of 40 specimens
the records themselves speak for it by 4 nats, about what a unit's two parameters cost."""


def signal(
    world: World,
    order: int,
    fewer: int,
    truth: Mapping[str, FloatArray],
    with_error: bool = False,
    enough: float = 0.0,
) -> float:
    """D of the closest of the models of `fewer` units, of several climbs; infinite for none.

    Parameters
    ----------
    order : units of the truth.
    truth : its parameters by name, those of the noise included, each (1,).
    with_error : whether the records also have the world's smooth error, whose law counts as known.
    enough : the search ends as soon as it finds less than this.
    """
    if fewer == 0:
        return float("inf")
    target = world.conditioned(fewer, true_curves(world, order, truth))
    smooth_in = world.smooth_in if with_error else None
    least, z = _closest_curve(target, truth, smooth_in, enough)
    if least < enough:
        return least
    return min(least, _closest_noise(target, truth, smooth_in, z))


def _closest_curve(
    target: LogPosterior,
    truth: Mapping[str, FloatArray],
    smooth_in: SmoothIn | None,
    enough: float,
) -> tuple[float, FloatArray]:
    """Least r' C^-1 r / 2, with the true noise, and where in z (d,) it is."""
    from scipy.optimize import least_squares

    material = _material(target)
    roots = whitening(target, truth, smooth_in)
    z = np.random.default_rng(0).standard_normal((TRIED, len(material)))
    sizes = np.sum(whitened(target, material, z, roots) ** 2, axis=1)

    def jacobian(point: FloatArray) -> FloatArray:
        shifts = STEP * np.eye(point.size)
        moved = whitened(target, material, np.vstack([point + shifts, point - shifts]), roots)
        return (moved[: point.size] - moved[point.size :]).T / (2.0 * STEP)

    least, closest = np.inf, np.zeros(target.dimension)
    for start in z[np.argsort(sizes)[:CLIMBED]]:
        climb = least_squares(
            lambda point: whitened(target, material, point[None], roots)[0],
            np.clip(start, -FURTHEST + 0.1, FURTHEST - 0.1),
            jacobian,
            bounds=(-FURTHEST, FURTHEST),
        )
        if climb.cost < least:
            least, closest[material] = float(climb.cost), climb.x
        if least < enough:
            break
    return least, closest


def _closest_noise(
    target: LogPosterior,
    truth: Mapping[str, FloatArray],
    smooth_in: SmoothIn | None,
    closest: FloatArray,
) -> float:
    """Least divergence over curves and noise, of climbs that start from z (d,) of a curve."""
    from scipy.optimize import minimize

    known = [np.linalg.inv(root) for root in whitening(target, truth, smooth_in)]
    noise = [k for k, name in enumerate(target.names) if "." in name]
    values = target.prior.to_parameters(closest[None])
    values[0, noise] = [float(truth[target.names[k]][0]) for k in noise]
    true_noise = np.clip(target.prior.to_normal(values)[0], -FURTHEST, FURTHEST)[noise]
    climbs = []
    for noise_start in (true_noise, 0.0, 2.0):
        start = closest.copy()
        start[noise] = noise_start
        climbs.append(
            minimize(
                lambda z: divergence(target, z, known, smooth_in),
                start,
                method="L-BFGS-B",
                bounds=[(-FURTHEST, FURTHEST)] * start.size,
            ).fun
        )
    return float(min(climbs))


def divergence(
    target: LogPosterior, z: FloatArray, known: Sequence[FloatArray], smooth_in: SmoothIn | None
) -> float:
    """Divergence of the records' distribution from that of the model at z (d,), nats.

    Parameters
    ----------
    target : a model whose records are the true curves.
    known : by record, L (N, N) with L L' the covariance of the true noise and error.
    """
    draws = target.draws(target.prior.to_parameters(z[None]))
    roots = whitening(target, draws, smooth_in)
    total = 0.0
    for record, root, true_root in zip(target.records, roots, known, strict=True):
        response = record.simulate(draws)
        residuals = record.scale.residuals(record.experiment.response, response)[0]
        ratio = root @ true_root
        total += float(np.sum((root @ residuals) ** 2) + np.sum(ratio**2) - len(ratio))
        total -= 2.0 * float(np.linalg.slogdet(ratio)[1])
    return 0.5 * total if np.isfinite(total) else FAILED


def _material(target: LogPosterior) -> list[int]:
    """Columns of z that are no noise parameters."""
    return [k for k, name in enumerate(target.names) if "." not in name]


def true_curves(world: World, order: int, truth: Mapping[str, FloatArray]) -> list[Experiment]:
    """The records of the world as the truth would leave them without noise."""
    system = world.conditioned(order, world.records).system
    return [replace(r, response=system.simulator_of(r)(truth)[0]) for r in world.records]


def whitening(
    target: LogPosterior, truth: Mapping[str, FloatArray], smooth_in: SmoothIn | None = None
) -> list[FloatArray]:
    """Matrices (N, N), by record, that turn residuals of the truth into standard normals.

    Parameters
    ----------
    smooth_in : coordinate of a smooth error of the records; None if they have noise alone.
    """
    roots = []
    for record in target.records:
        size = record.experiment.coordinate.size
        noise = {
            name: np.full(size, np.ravel(value)[0])
            for name, value in target.noise_draws(truth, record).items()
        }
        root = target.noise.innovations(
            np.eye(size), record.noise_coordinate, record.weights, noise
        ).T
        if smooth_in is not None:
            covariance = np.linalg.inv(root.T @ root)
            covariance += error_covariance(smooth_in, record.experiment)
            root = np.linalg.inv(np.linalg.cholesky(covariance))
        roots.append(root)
    return roots


def whitened(
    target: LogPosterior, material: list[int], z: FloatArray, roots: Sequence[FloatArray]
) -> FloatArray:
    """Residuals (S, N) of draws z (S, m) of the material, each N(0, 1) at the truth."""
    whole = np.zeros((len(z), target.dimension))
    whole[:, material] = z
    draws = target.draws(target.prior.to_parameters(whole))
    parts = [
        record.scale.residuals(record.experiment.response, record.simulate(draws)) @ root.T
        for record, root in zip(target.records, roots, strict=True)
    ]
    joined = np.concatenate(parts, axis=1)
    return np.where(np.isfinite(joined), joined, FAILED)
