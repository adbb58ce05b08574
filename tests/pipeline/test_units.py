"""Units: conversion to SI, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from deabayes.faults import UserError
from deabayes.prediction.given import array_in_si
from deabayes.units import parse_quantity, registry, same_dimension, si_unit, to_si


@pytest.mark.parametrize(
    ("value", "unit", "expected_unit", "si"),
    [
        (2.5, "kV", "V", 2500.0),
        (22.0, "mm^2", "m^2", 22e-6),
        (22.0, "mm²", "m^2", 22e-6),
        (0.1, "N*s/m", "N*s/m", 0.1),
        (0.1, "N s/m", "N*s/m", 0.1),
        (3.0, "%", "1", 0.03),
        (3.0, "percent", "1", 0.03),
        (3.0, "%/V", "1/V", 0.03),
        (1.5, "", "1", 1.5),
        (1.5, "1", "1", 1.5),
        (1.5, "-", "1", 1.5),
        (180.0, "deg", "rad", np.pi),
        (180.0, "°", "rad", np.pi),
        (1.0, "MPa", "Pa", 1e6),
        (40.0, "µm", "m", 40e-6),
        (40.0, "um", "m", 40e-6),
        (156.56, "g*mm^2", "kg*m^2", 156.56e-9),
        (0.2, "N*m/rad", "N*m", 0.2),
        (20.0, "degC", "K", 293.15),
        (2.0, "1/s", "Hz", 2.0),
    ],
)
def test_conversion_to_si(value: float, unit: str, expected_unit: str, si: float) -> None:
    assert to_si(value, unit, expected_unit, "here") == pytest.approx(si, rel=1e-12)


def test_arrays_keep_their_shape_and_the_input_is_untouched() -> None:
    values = np.array([[1.0, 2.0], [3.0, np.nan]])
    converted = to_si(values, "mm", "m", "here")
    np.testing.assert_allclose(converted, values * 1e-3)
    assert values[0, 0] == 1.0


@pytest.mark.parametrize(
    ("unit", "expected_unit", "words"),
    [
        ("V", "m", ["'V'", "a voltage", "a length", "'m'"]),
        ("deg", "1", ["an angle", "a plain number"]),
        ("1", "rad", ["a plain number", "an angle"]),
        ("rad/s", "Hz", ["an angular frequency", "a frequency"]),
        ("kv", "V", ["unknown unit 'kv'", "did you mean 'kV'"]),
        ("Newton", "N", ["unknown unit 'Newton'", "did you mean 'N'?"]),
        ("Millimeter", "m", ["did you mean 'mm'?"]),
        ("10 mn", "m", ["unknown unit '10 mn'"]),
        ("(", "m", ["unknown unit '('", "such as 'kV'"]),
        ("m**", "m", ["unknown unit 'm**'"]),
        *[(u, "m", [f"{u!r}: a pixel has no size", "mm"]) for u in "px Pixel dot Mpx".split()],
        *[(u, "m^2", [f"{u!r}: a pixel has no size"]) for u in ("px^2", "pixel/mm")],
    ],
)
def test_wrong_units_are_named_with_a_remedy(
    unit: str, expected_unit: str, words: list[str]
) -> None:
    with pytest.raises(UserError) as caught:
        to_si([1.0], unit, expected_unit, "a.csv, column voltage")
    assert str(caught.value).startswith("a.csv, column voltage: ")
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected_unit", "si"),
    [
        ("35 kPa", "Pa", 35e3),
        ("35kPa", "Pa", 35e3),
        ("-1.5e-3 mm", "m", -1.5e-6),
        (".5 s", "s", 0.5),
        ("0.5", "1", 0.5),
        ("12 %", "1", 0.12),
        (35e3, "Pa", 35e3),
        (3, "Pa", 3.0),
    ],
)
def test_parse_quantity(text: str | float, expected_unit: str, si: float) -> None:
    assert parse_quantity(text, expected_unit, "here") == pytest.approx(si, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("35", ["no unit", "'35 Pa'"]),
        ("kPa", ["expected a number and a unit", "'kPa'"]),
        ("35 mm", ["a length", "a stress"]),
        ("3,5 kPa", ["has a decimal comma", "'3.5 kPa'"]),
        (True, ["found True"]),
        (None, ["found None"]),
    ],
)
def test_parse_quantity_refuses(text: object, words: list[str]) -> None:
    with pytest.raises(UserError) as caught:
        parse_quantity(text, "Pa", "config.yaml, priors.mu_alpha.median")  # type: ignore[arg-type]
    for word in ["config.yaml, priors.mu_alpha.median: ", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("unit", "si"), [("kV", "V"), ("%", "1"), ("g", "kg"), ("mm/min", "m/s"), ("deg", "rad")]
)
def test_si_unit(unit: str, si: str) -> None:
    assert si_unit(unit) == si


def test_si_unit_of_an_unusual_dimension_converts_back() -> None:
    unit = si_unit("kV/mm")
    assert to_si(1.0, "kV/mm", None) == pytest.approx(1e6)
    assert same_dimension(unit, "V/m")
    assert not same_dimension("V", "m") and not same_dimension("nonsense", "m")


def _masked(mask: list[bool]) -> np.ma.MaskedArray:
    return np.ma.masked_array([1.0, 2.0, 3.0], mask=mask)


def test_masked_values_are_refused_where_any_is_masked() -> None:
    whole = _masked([False, False, False])
    np.testing.assert_array_equal(array_in_si(whole, "V", "voltage"), [1.0, 2.0, 3.0])
    part = _masked([False, True, False])
    for given in (part, registry().Quantity(part, "kV"), [part, part]):
        with pytest.raises(UserError, match=r"voltage: .*masked.*; leave out"):
            array_in_si(given, "V", "voltage")


def test_one_registry() -> None:
    assert registry() is registry()


def test_a_decimal_comma_is_named() -> None:
    with pytest.raises(UserError, match=r"mu: '1,5' has a decimal comma"):
        parse_quantity("1,5", "1", "mu")
    texts = np.array(["0", "0,0004", "1,5"], dtype=object)
    with pytest.raises(UserError, match=r"voltage: found texts with a decimal comma \('0,0004'\)"):
        array_in_si(texts, "V", "voltage")
