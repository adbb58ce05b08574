"""Numbers, units and symbols as pages and figures show them."""

from __future__ import annotations

import pytest

from deabayes.quantities import (
    display_unit,
    interval,
    pretty_unit,
    round_to,
    significant,
    symbol_html,
    symbol_text,
)


@pytest.mark.parametrize(
    ("unit", "value", "label", "factor"),
    [
        ("Pa", 35e3, "kPa", 1e3),
        ("Pa", 1.5e6, "MPa", 1e6),
        ("s", 6e-3, "ms", 1e-3),
        ("s", 600.0, "s", 1.0),
        ("m", 40e-6, "µm", 1e-6),
        ("m", 0.0, "m", 1.0),
        ("Pa*s", 1e5, "kPa·s", 1e3),
        ("N*s/m", 0.1, "mN·s/m", 1e-3),
        ("N/m", 66.0, "N/m", 1.0),
        ("ohm", 1e9, "GΩ", 1e9),
        ("m**2", 6e-4, "mm²", 1e-6),
        ("1", 4.7, "", 1.0),
        ("F/m", 4.11e-11, "pF/m", 1e-12),
    ],
)
def test_display_units(unit: str, value: float, label: str, factor: float) -> None:
    found = display_unit(unit, value)
    assert (found.label, found.factor) == (label, factor)


def test_numbers_keep_what_their_interval_supports() -> None:
    assert interval(35.234, 33.9, 36.6) == "35.2 [33.9, 36.6]"
    assert interval(1234.4, 1000.0, 1500.0) == "1230 [1000, 1500]"
    assert round_to(-0.01234, 0.001) == "−0.0123"
    assert round_to(float("nan"), 1.0) == "–"
    assert interval(0.4, -0.004, 0.9) == "0.40 [0.00, 0.90]"
    assert interval(569.2, 144.7, 7186.0) == "570 [140, 7200]"
    assert interval(-0.332, -2.877, -0.357) == "−0.33 [−2.9, −0.36]"
    assert interval(5.234, 2.11, 12.4) == "5.2 [2.1, 12.4]"
    assert significant(1.704) == "1.70"
    assert significant(0.000012345) == "1.23×10⁻⁵"


def test_symbols() -> None:
    assert symbol_html(r"\mu_\alpha") == "μ<sub>α</sub>"
    assert symbol_html(r"\mu_{\beta 1}") == "μ<sub>β1</sub>"
    assert symbol_html(r"\sigma_\mathrm{OU}") == "σ<sub>OU</sub>"
    assert symbol_html("<script>") == "&lt;script&gt;"
    assert symbol_text("creep.sigma_ou", r"\sigma") == r"creep: $\sigma$"
    assert pretty_unit("kg*m^2") == "kg·m²"
