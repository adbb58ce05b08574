"""Default priors of noise parameters, shared by the noise models."""

from __future__ import annotations

import math

from deabayes.distributions import LogNormal, LogUniform
from deabayes.faults import UserError
from deabayes.parameter import Parameter

WHITE_FRACTION, WHITE_SIGMA = 0.003, 1.5
CORRELATED_FRACTION, CORRELATED_SIGMA = 0.01, 1.2
OFFSET_FRACTION = 0.001
SHORTEST_LENGTH, LENGTH_FRACTION = 1e-4, 0.1


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


def offset_amplitude(unit: str, scale: float) -> Parameter:
    """Standard deviation of the zeros of records."""
    _check_positive("range of the response", scale)
    return Parameter(
        "sigma_offset",
        r"\sigma_\mathrm{off}",
        unit,
        "standard deviation of what records' zeros are off by",
        LogNormal(OFFSET_FRACTION * scale, CORRELATED_SIGMA),
        "assumed: a record's zero is known to 0.1 % of the response's range, within a factor 10",
    )


def correlation_length(name: str, symbol: str, coordinate_unit: str, span: float) -> Parameter:
    """Correlation time (or length) with 95 % of its prior below a tenth of the record.

    The bound is a hard one: under structural error the likelihood would rather have
    noise that lasts as long as the record, and lift whole curves off their data.
    """
    _check_positive("extent of the coordinate", span)
    shortest, tenth = SHORTEST_LENGTH * span, LENGTH_FRACTION * span
    longest = shortest * (tenth / shortest) ** (1.0 / 0.95)
    return Parameter(
        name,
        symbol,
        coordinate_unit,
        "correlation length of the noise along the coordinate",
        LogUniform(shortest, longest),
        "95 % below a tenth of the median record, lest noise take the model's slow processes",
    )


def _check_positive(what: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise UserError(
            f"noise priors: the {what} is {value}; a record needs at least two different values "
            "of coordinate and response"
        )
