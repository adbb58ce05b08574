"""Preparation steps that change the excitation, and polylines that describe it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.integrate.amplifier import Amplifier
from deabayes.quantities import with_unit
from deabayes.records.channels import white_noise
from deabayes.records.preparation.working import IntArray, Settings, WorkingRecord
from deabayes.systems.specimen_quantities import instrument

DEFAULT_FRACTION, LARGEST_FRACTION = 1e-3, 0.5
MANY_KNOTS = 5000
OVER_NOISE = 3.0
DEGREE = 5
SAMPLES_PER_PIECE = 4
LOAD = {"series_resistance": "ohm", "leakage_resistance": "ohm", "capacitance": "F"}
FORCES = ("force", "nominal_stress")
PULLS = ("stretch", "displacement")
RISE, FEWEST = (0.03, 0.3), 6
"""Shares of the largest force that bound the first rise of a pull, and its fewest samples."""
LEAST = 0.002
"""Smallest slack that is reported, in stretch or as a share of the excitation's range."""
STANDARD_ERRORS = 5.0
AT_REST = 0.25
"""Share of the mean force that a taut strip would have had before the rise. A larger force means
a stiffening rubber, not slack."""


def excitation_knots(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Reduce the excitation to a polyline that stays within a tolerance of every sample.

    The whole history is described, including masked times. Knots are measured samples; nothing
    is smoothed.

    Settings
    --------
    tolerance : in the excitation's unit, e.g. 0.05 mm, at most half of its range; or
    fraction : tolerance as a share of the excitation's range, default 0.001. For a voltage that
        is constant apart from noise, the range counts from zero.
    """
    read = Settings("excitation_knots", settings, record, ("tolerance", "fraction"))
    read.at_most_one("tolerance", "fraction")
    if read.has("tolerance"):
        tolerance = read.positive("tolerance", record.excitation_unit)
        most, unit = LARGEST_FRACTION * record.excitation_range, record.excitation_unit
        if tolerance > most:
            raise UserError(
                f"{read.where}.tolerance: {tolerance:.3g} {unit} is more than {most:.3g} {unit}, "
                f"half of the {record.row.excitation}'s range, so that a step becomes a ramp; "
                "give a smaller one, or `fraction`"
            )
    else:
        fraction = read.number("fraction", DEFAULT_FRACTION, 0.0, LARGEST_FRACTION)
        tolerance = fraction * record.excitation_range
    knots = polyline(record.excitation_coordinate, record.excitation, tolerance)
    reduced = replace(
        record,
        excitation_coordinate=record.excitation_coordinate[knots],
        excitation=record.excitation[knots],
    )
    if knots.size > MANY_KNOTS:
        why = "it turns that often; a wider tolerance needs fewer, `crop` shortens the record"
        if OVER_NOISE * white_noise(record.excitation, order=4) > tolerance:
            why = "its noise exceeds the tolerance; widen it"
        record.report.warn(
            f"the excitation needs {knots.size} knots for its {record.excitation.size} samples "
            f"within {tolerance:.3g} {record.excitation_unit}: {why}"
        )
    return reduced


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


def limit_current(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Treat the voltage as a command, and replace it by the amplifier's output.

    For records that hold the commanded voltage because the amplifier's monitor was not recorded.
    The load has its stated values and is uncharged when the record begins.

    Settings
    --------
    limit : largest current; default `instruments.current_limit` of specimen.yaml.
    series_resistance, leakage_resistance, capacitance : the load; default the specimen's
        `quantities`.
    """
    read = Settings("limit_current", settings, record, ("limit", *LOAD))
    if record.row.excitation != "voltage":
        raise UserError(
            f"{read.where}: only a voltage can be a command to the amplifier; this record's "
            f"excitation is {record.row.excitation!r}: remove the step"
        )
    amplifier = _amplifier(read, record)
    command = record.excitation
    times, values, limited = amplifier.output(record.excitation_coordinate, command)
    share = limited / float(np.ptp(record.excitation_coordinate))
    effect = f"the amplifier is at its limit for {1e3 * limited:.3g} ms, {share:.2%} of the record"
    return replace(
        record,
        excitation_coordinate=np.array(times),
        excitation=np.array(values),
        remarks={"effect": effect},
    )


def _amplifier(read: Settings, record: WorkingRecord) -> Amplifier:
    known = instrument(record.specimen, "current_limit", "current", "A")
    if known is None and not read.has("limit"):
        raise UserError(
            f"{read.where}: give `limit`, or `instruments: current_limit:` in specimen.yaml"
        )
    limit = read.positive("limit", "A", None if known is None else known.value)
    stated = record.specimen.quantities
    missing = [name for name in LOAD if name not in stated and not read.has(name)]
    if missing:
        raise UserError(
            f"{read.where}: give {', '.join(missing)} there or among `quantities` in "
            "specimen.yaml: what the amplifier charges"
        )
    load = (
        read.positive(name, unit, stated[name].value if name in stated else None)
        for name, unit in LOAD.items()
    )
    return Amplifier(limit, *load)


def take_up_slack(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Remove from the excitation the part before the strip became taut.

    A displacement counts from the taut point. A stretch is divided by its value there, because
    the taut strip is longer by that factor. Samples before that point are hidden.

    Settings
    --------
    until : the excitation at which the strip becomes taut; by default the parabola fitted to the
        first rise of the force gives it at zero force.
    """
    read = Settings("take_up_slack", settings, record, ("until",))
    end = slack_end(record)
    usual = float(record.excitation[0]) if end is None else end
    taut = read.quantity("until", record.excitation_unit, usual)
    driven = np.interp(record.coordinate, record.excitation_coordinate, record.excitation)
    hidden = np.logical_and.accumulate(driven < taut)
    values = np.maximum(record.excitation, taut)
    stretched = record.row.excitation == "stretch"
    return replace(record.mask(hidden), excitation=values / taut if stretched else values - taut)


def slack_end(record: WorkingRecord) -> float | None:
    """Return the excitation at which the force begins to rise; None if it rises at once.

    A parabola of excitation over force, fitted from 3 to 30 % of the largest force, is
    extrapolated to zero force.
    """
    row = record.row
    if row.response not in FORCES or row.excitation not in PULLS:
        return None
    peak = int(np.argmax(record.response))
    driven = np.interp(record.coordinate, record.excitation_coordinate, record.excitation)
    force = record.response[: peak + 1] / (record.response[peak] or 1.0)
    past = np.flatnonzero(force > RISE[1])
    rise = np.flatnonzero(force[: past[0] if past.size else 0] > RISE[0])
    if rise.size < FEWEST:
        return None
    f, x = force[rise[0] : past[0]], driven[rise[0] : past[0]]
    basis = np.vander(f, 3, increasing=True)
    inverse = np.linalg.pinv(basis.T @ basis)
    parabola = inverse @ basis.T @ x
    variance = float(np.sum((x - basis @ parabola) ** 2)) / (f.size - 3)
    error = float(np.sqrt(variance * inverse[0, 0]))
    least = LEAST * (1.0 if row.excitation == "stretch" else float(np.ptp(driven)))
    taut = float(parabola[0])
    slack = taut - float(driven[0])
    if slack <= max(least, STANDARD_ERRORS * error):
        return None
    if_taut = 0.5 * slack / float(parabola[1])
    before = force[driven[: peak + 1] < taut]
    return taut if abs(float(np.mean(before))) < AT_REST * if_taut else None


def warn_of_slack(record: WorkingRecord, end: float) -> None:
    """Warn of slack up to the excitation `end` that no step takes up."""
    name, protocol = record.row.excitation, record.row.protocol
    at = with_unit(end, record.excitation_unit, name, digits=4)
    record.report.warn(
        f"the {record.row.response} begins to rise at a {name} of {at}: the strip hangs slack "
        f"until then, and a modulus comes out too small; put `take_up_slack: {{}}` first in "
        f"`preparation: {protocol}`"
    )


def polyline(coordinate: FloatArray, values: FloatArray, tolerance: float) -> IntArray:
    """Return indices of samples joined by straight lines within `tolerance` of all samples.

    From each knot, the slopes that pass all following samples within the tolerance form a
    narrowing cone. The next knot is the last sample within the cone of all samples before it.
    This is the cone intersection method of Sklansky and Gonzalez (1980), with errors measured
    along `values`. It passes through the record once.

    Parameters
    ----------
    coordinate, values : (M,) samples; the coordinate never descends, and where it repeats, the
        curve jumps.
    tolerance : largest allowed |line - sample|, in the unit of `values`.

    Returns
    -------
    (K,) ascending indices, which include the first and the last sample.
    """
    x, y = coordinate.tolist(), values.tolist()
    knots = [0]
    while knots[-1] < len(x) - 1:
        knots.append(_furthest(x, y, knots[-1], tolerance))
    return np.array(knots, dtype=np.intp)


def _furthest(x: list[float], y: list[float], start: int, tolerance: float) -> int:
    """Last sample that a line from `start` reaches while all between are within tolerance."""
    x0, y0 = x[start], y[start]
    low, high = -np.inf, np.inf
    reached = start + 1
    for index in range(start + 1, len(x)):
        run, rise = x[index] - x0, y[index] - y0
        if run == 0.0:
            if abs(rise) > tolerance:
                break
            reached = index
            continue
        if low <= rise / run <= high:
            reached = index
        low = max(low, (rise - tolerance) / run)
        high = min(high, (rise + tolerance) / run)
        if low > high:
            break
    return reached


def corners(
    coordinate: FloatArray, values: FloatArray, tolerance: float, interval: float
) -> FloatArray:
    """Return the coordinates where an excitation turns: ramp ends, steps, peaks of triangles.

    These are the inner `turns`. A jump within one sampling `interval` has two turns; only the
    later counts as a corner.
    """
    knots = turns(coordinate, values, tolerance)
    inner = coordinate[knots[1:-1]]
    before_jump = np.diff(coordinate[knots[1:]]) <= 1.5 * interval
    return inner[~before_jump]


def turns(coordinate: FloatArray, values: FloatArray, tolerance: float) -> IntArray:
    """Indices of a Ramer-Douglas-Peucker polyline (Douglas and Peucker 1973) within `tolerance`.

    Unlike the knots of `polyline`, these lie at the turns themselves. Both ends are included.
    """
    thinned = polyline(coordinate, values, 0.1 * tolerance)
    return thinned[_worst_first(coordinate[thinned], values[thinned], tolerance)]


def _worst_first(coordinate: FloatArray, values: FloatArray, tolerance: float) -> IntArray:
    """Ramer-Douglas-Peucker: split pieces at their worst sample until within `tolerance`."""
    knots, pending = {0, coordinate.size - 1}, [(0, coordinate.size - 1)]
    while pending:
        first, last = pending.pop()
        if last - first < 2:
            continue
        inside = slice(first + 1, last)
        line = np.interp(coordinate[inside], coordinate[[first, last]], values[[first, last]])
        error = np.abs(line - values[inside])
        worst = first + 1 + int(np.argmax(error))
        if error[worst - first - 1] > tolerance:
            knots.add(worst)
            pending += [(first, worst), (worst, last)]
    return np.array(sorted(knots), dtype=np.intp)
