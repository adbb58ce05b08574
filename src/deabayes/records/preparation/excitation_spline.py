"""Preparation step: describe the excitation by a smooth curve, for responses to its slope."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.records.preparation.working import Settings, WorkingRecord

DEGREE = 5
SAMPLES_PER_PIECE = 4


def excitation_spline(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Replace the excitation after `from` by a spline with denser samples.

    The current into a capacitance follows the slope of the voltage. Straight lines between
    samples an interval h apart have a slope that lags by up to h/2. Noise of one volt appears as
    a current of the capacitance over h. A least-squares spline with pieces of length `interval`
    avoids both and does not shift phases. The model then follows straight lines between values
    of the spline, `spacing` apart. Samples before `from` (a jump, a limited amplifier) stay as
    measured.

    Settings
    --------
    interval : length of the spline's pieces, of degree five; at most a tenth of a sine's period.
        Longer pieces suppress more of the monitor's noise.
    spacing : distance of the new knots; choose a fraction of the fastest time constant.
    from : start of the smooth stretch; default the first sample.
    from_step : count `from` from the start of the excitation; default false.
    """
    keys = ("interval", "spacing", "from", "from_step")
    read = Settings("excitation_spline", settings, record, keys)
    interval = read.positive("interval", record.coordinate_unit)
    spacing = read.positive("spacing", record.coordinate_unit)
    time, values = record.excitation_coordinate, record.excitation
    smooth = time >= (read.coordinate("from") if read.has("from") else time[0])
    pieces = int(np.ptp(time[smooth]) // interval) if smooth.any() else 0
    if pieces < 1 or smooth.sum() < SAMPLES_PER_PIECE * pieces:
        raise UserError(
            f"{read.where}: {int(smooth.sum())} samples of the excitation for {pieces} pieces of "
            f"{interval:g} {record.coordinate_unit}; each needs {SAMPLES_PER_PIECE}, change "
            "`interval` or `from`"
        )
    gap = float(np.max(np.diff(time[smooth])))
    if gap > interval:
        raise UserError(
            f"{read.where}: samples of the excitation are up to {gap:.4g} {record.coordinate_unit} "
            f"apart, and over more than a piece of {interval:g} {record.coordinate_unit} the curve "
            "would be free; begin behind the gap with `from`, cut the file before it, or use "
            "`excitation_knots`"
        )
    knots, curve = _spline(time[smooth], values[smooth], pieces, spacing)
    return replace(
        record,
        excitation_coordinate=np.concatenate([time[~smooth], knots]),
        excitation=np.concatenate([values[~smooth], curve]),
    )


def _spline(
    time: FloatArray, values: FloatArray, pieces: int, spacing: float
) -> tuple[FloatArray, FloatArray]:
    """Return new knots (K,), with both end samples, and the spline's values there."""
    from scipy.interpolate import make_lsq_spline

    inner = np.linspace(time[0], time[-1], pieces + 1)[1:-1]
    ends = np.repeat([time[0], time[-1]], DEGREE + 1)
    breaks = np.concatenate([ends[: DEGREE + 1], inner, ends[DEGREE + 1 :]])
    spline = make_lsq_spline(time, values, breaks, k=DEGREE)
    knots = np.linspace(time[0], time[-1], int(np.ceil(np.ptp(time) / spacing)) + 1)
    return knots, np.asarray(spline(knots), dtype=np.float64)
