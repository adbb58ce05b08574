"""A specimen's uncertain quantities as parameters, in every system."""

from __future__ import annotations

import numpy as np
import pytest

from deabayes.experiment import Quantity, Specimen
from deabayes.faults import UserError
from deabayes.systems.specimen_quantities import uncertain_quantities

UNITS = {"thickness": "m", "permittivity": "1"}


def specimen(**quantities: Quantity) -> Specimen:
    return Specimen("piece", "tubular", {}, quantities)


@pytest.mark.parametrize("sd", [1e-6, 4e-5, 2e-4])
def test_the_stated_value_is_the_median_and_the_ratio_the_variation(sd: float) -> None:
    (parameter,) = uncertain_quantities(
        specimen(thickness=Quantity(80e-6, "m", sd, "caliper")), {"thickness": "d"}, UNITS
    )
    z = np.linspace(-8.0, 8.0, 4001)
    x = parameter.prior.from_normal(z)
    weight = np.exp(-0.5 * z**2) / np.exp(-0.5 * z**2).sum()
    mean = np.sum(weight * x)
    spread = np.sqrt(np.sum(weight * (x - mean) ** 2))
    assert parameter.prior.from_normal(np.zeros(1))[0] == pytest.approx(80e-6)
    assert spread / mean == pytest.approx(sd / 80e-6, rel=1e-3)
    assert (parameter.name, parameter.symbol, parameter.unit) == ("thickness", "d", "m")
    assert (parameter.source, parameter.description) == ("caliper", "thickness of the specimen")


def test_exact_missing_and_unused_quantities_are_no_parameters() -> None:
    given = specimen(
        thickness=Quantity(8e-5, "m"),
        mass=Quantity(1e-3, "kg", 1e-5),
        permittivity=Quantity(3.1, "1", 0.1),
    )
    symbols = {"permittivity": (r"\varepsilon", "of the film"), "thickness": "d", "length": "L"}
    (parameter,) = uncertain_quantities(given, symbols, UNITS)
    assert (parameter.name, parameter.description) == ("permittivity", "of the film")
    assert parameter.source == "specimen.yaml"


@pytest.mark.parametrize("value", [0.0, -8e-5])
def test_an_uncertain_quantity_is_positive(value: float) -> None:
    given = specimen(thickness=Quantity(value, "m", 1e-6))
    with pytest.raises(UserError, match=r"quantities\.thickness: must be positive"):
        uncertain_quantities(given, {"thickness": "d"}, UNITS)
