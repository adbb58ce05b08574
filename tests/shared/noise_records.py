"""Coordinates of made-up records, and draws of a noise model's parameters."""

import numpy as np

from deabayes.noise import REGISTRY


def make_draws(name, size, rng):
    """Draws over a wide range of the model's parameters."""
    draws = {}
    for parameter in REGISTRY[name]().parameters("1", 1.0, 100.0):
        middle = {"s": 3.0, "1": 0.5}[parameter.unit]
        if parameter.name == "degrees_of_freedom":
            middle = 5.0
        draws[parameter.name] = middle * np.exp(rng.normal(0.0, 1.0, size))
    return draws


def record(rng, size=60, grid="irregular"):
    """Coordinate and weights of a record."""
    if grid == "regular":
        return 0.1 * np.arange(size), np.ones(size)
    return np.sort(rng.uniform(0.0, 50.0, size)), 1.0 / rng.integers(1, 30, size)


def one(draws, k):
    return {name: values[k] for name, values in draws.items()}
