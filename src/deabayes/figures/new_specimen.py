"""Predictions for a new specimen, beside the records of the population's first member."""

from __future__ import annotations

from matplotlib.figure import Figure

from deabayes.figures import data_and_bands
from deabayes.figures.results import PopulationResults

SCOPE = "population"
TITLE = "A new specimen"
CAPTION = (
    "Response of a new specimen of the population to the records of its first member, with three "
    "separate 90 % bands that include the spread between specimens. The points are the first "
    "member's. The population was fitted to them, so points inside the bands do not test it. "
    "Noise, geometry and whatever else is not a parameter of the population are those of the first "
    "member."
)


def draw(results: PopulationResults) -> list[Figure]:
    """Return one sheet per nine records."""
    return data_and_bands.draw(
        results.new_specimen,
        role="predicted for a new specimen",
        observed="observed on the first member",
    )
