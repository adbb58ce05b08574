"""Default priors of noise parameters, shared by the noise models."""

from __future__ import annotations

import math

from deabayes.distributions import LogNormal
from deabayes.faults import UserError
from deabayes.parameter import Parameter

WHITE_FRACTION, WHITE_SIGMA = 0.003, 1.5
CORRELATED_FRACTION, CORRELATED_SIGMA = 0.01, 1.2
LENGTH_SIGMA, LENGTH_FRACTION = 1.2, 0.1
QUANTILE_95 = 1.6448536269514722


def white_amplitude(unit: str, scale: float, name: str = "sigma_white") -> Parameter:
    """Standard deviation of the white noise of one raw sample."""
    _check_positive("range of the response", scale)
    return Parameter(
        name,
        r"\sigma_\mathrm{w}",
        unit,
        "standard deviation of white noise, one raw sample",
        LogNormal(WHITE_FRACTION * scale, WHITE_SIGMA),
        "assumed: a sensor's noise is 0.3 % of the response's range, within a factor 20",
    )


def correlated_amplitude(name: str, symbol: str, unit: str, scale: float) -> Parameter:
    """Standard deviation of the correlated noise."""
    _check_positive("range of the response", scale)
    return Parameter(
        name,
        symbol,
        unit,
        "standard deviation of correlated noise",
        LogNormal(CORRELATED_FRACTION * scale, CORRELATED_SIGMA),
        "assumed: drift and model error are 1 % of the response's range, within a factor 10",
    )


def correlation_length(name: str, symbol: str, coordinate_unit: str, span: float) -> Parameter:
    """Correlation time (or length) with 95 % of its prior below a tenth of the record."""
    _check_positive("extent of the coordinate", span)
    median = LENGTH_FRACTION * span * math.exp(-QUANTILE_95 * LENGTH_SIGMA)
    return Parameter(
        name,
        symbol,
        coordinate_unit,
        "correlation length of the noise along the coordinate",
        LogNormal(median, LENGTH_SIGMA),
        "95 % below a tenth of the record, lest noise take the model's slow processes",
    )


def _check_positive(what: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise UserError(
            f"noise priors: the {what} is {value}; a record needs at least two different values "
            "of coordinate and response"
        )
