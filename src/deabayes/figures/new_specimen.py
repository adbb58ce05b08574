"""Predictions for a new specimen, beside the records of the population's first member."""

from __future__ import annotations

from matplotlib.figure import Figure

from deabayes.figures import data_and_bands
from deabayes.figures.results import PopulationResults

SCOPE = "population"
TITLE = "A new specimen"
CAPTION = (
    "Response of a new specimen of the population to the records of its first member, with three "
    "separate 90 % bands that hold the spread between specimens. Points are the first member's, "
    "which the population has seen: that they lie inside is no test of it. What is not a "
    "parameter of the population, noise and geometry, is as of the first member."
)


def draw(results: PopulationResults) -> list[Figure]:
    """Return one sheet per nine records."""
    return data_and_bands.draw(
        results.new_specimen,
        role="predicted for a new specimen",
        observed="observed on the first member",
    )
