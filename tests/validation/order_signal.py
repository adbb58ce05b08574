"""How much of a specimen's last unit its records can show at all.

With r the difference between the true curves and the closest that fewer units can make of
them, and C the covariance of the true noise, D = r' C^-1 r / 2 is the expected logarithm of
the likelihood ratio of the two curves, in nats; its sd is sqrt(2 D). It depends on the truth
and not on the noise that happened to be added, so it sorts specimens without looking at what
was decided.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.experiment import Experiment, FloatArray
from deabayes.inference.log_posterior import LogPosterior
from tests.validation.worlds import World

TRIED, CLIMBED = 1000, 6
FURTHEST = 6.0
STEP = 1e-4
FAILED = 1e4
"""A residual in noise sds where a curve does not exist."""
SHOWN = 17.0
"""Nats from which on a unit counts as shown: D - 2 sqrt(2 D) > 4, so that in 39 of 40
specimens the records themselves speak for it by the 4 nats that the rule asks for."""


def signal(world: World, order: int, fewer: int, truth: Mapping[str, FloatArray]) -> float:
    """D of the closest of the models of `fewer` units, of several climbs; infinite for none.

    Parameters
    ----------
    order : units of the truth.
    truth : its parameters by name, those of the noise included, each (1,).
    """
    from scipy.optimize import least_squares

    if fewer == 0:
        return float("inf")
    target = world.conditioned(fewer, true_curves(world, order, truth))
    material = [k for k, name in enumerate(target.names) if "." not in name]
    z = np.random.default_rng(0).standard_normal((TRIED, len(material)))
    sizes = np.sum(whitened(target, material, z, truth) ** 2, axis=1)

    def jacobian(point: FloatArray) -> FloatArray:
        shifts = STEP * np.eye(point.size)
        moved = whitened(target, material, np.vstack([point + shifts, point - shifts]), truth)
        return (moved[: point.size] - moved[point.size :]).T / (2.0 * STEP)

    costs = [
        least_squares(
            lambda point: whitened(target, material, point[None], truth)[0],
            np.clip(start, -FURTHEST + 0.1, FURTHEST - 0.1),
            jacobian,
            bounds=(-FURTHEST, FURTHEST),
        ).cost
        for start in z[np.argsort(sizes)[:CLIMBED]]
    ]
    return float(min(costs))


def true_curves(world: World, order: int, truth: Mapping[str, FloatArray]) -> list[Experiment]:
    """The records of the world as the truth would leave them without noise."""
    system = world.conditioned(order, world.records).system
    return [replace(r, response=system.simulator_of(r)(truth)[0]) for r in world.records]


def whitened(
    target: LogPosterior, material: list[int], z: FloatArray, truth: Mapping[str, FloatArray]
) -> FloatArray:
    """Residuals (S, N) of draws z (S, m) of the material under the true noise, each N(0, 1)."""
    whole = np.zeros((len(z), target.dimension))
    whole[:, material] = z
    draws = dict(target.draws(target.prior.to_parameters(whole)))
    draws |= {name: np.full(len(z), truth[name][0]) for name in draws if "." in name}
    parts = []
    for record in target.records:
        residuals = record.scale.residuals(record.experiment.response, record.simulate(draws))
        noise = target.noise_draws(draws, record.group)
        parts.append(
            target.noise.innovations(residuals, record.noise_coordinate, record.weights, noise)
        )
    joined = np.concatenate(parts, axis=1)
    return np.where(np.isfinite(joined), joined, FAILED)
