"""Properties of an excitation: steps, prehistory, and values stated in experiments.csv."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from deabayes.experiment import FloatArray, Specimen
from deabayes.faults import UserError
from deabayes.integrate.periodic import passes, usual_period
from deabayes.quantities import with_unit
from deabayes.records.columns import COMMANDS, ExperimentRow, RawRecord
from deabayes.systems import system_class

STEPS = ("creep", "step")
HELD_CONSTANT = 0.01
MONITOR_NOISE = 10.0
"""Range of a monitored voltage at rest [V]; the force at 10 V is 1e-5 of the force at 3 kV."""
WIDEST_NOISE = 12.0
"""Largest range of white noise over its standard deviation; for 10^5 normal numbers it is 9."""


def is_held(voltage: FloatArray) -> bool:
    """Whether a voltage [V] varies by at most 1 % or a monitor's noise."""
    allowed = max(HELD_CONSTANT * abs(float(np.mean(voltage))), MONITOR_NOISE)
    return float(np.ptp(voltage)) <= allowed


def is_step_from_the_start(protocol: str, excitation: FloatArray, unit: str) -> bool:
    """Whether the excitation of a creep or step is on and constant from its first sample.

    A voltage may have a monitor's noise, which changes from sample to sample. A small step on a
    bias, or a drift, does not count as constant.
    """
    spread, size = float(np.ptp(excitation)), abs(float(np.mean(excitation)))
    noise = float(np.std(np.diff(excitation))) / np.sqrt(2.0) if unit == "V" else 0.0
    constant = spread <= WIDEST_NOISE * noise and is_held(excitation)
    return protocol in STEPS and constant and spread < size


def excitation_range(protocol: str, excitation: FloatArray, unit: str) -> float:
    """Largest change of an excitation; for a step at its first sample, its largest size."""
    if is_step_from_the_start(protocol, excitation, unit):
        return float(np.max(np.abs(excitation)))
    return float(np.ptp(excitation))


NEAR = 0.02
"""Share of the largest excitation; a smaller first value is an offset, not a jump."""


def knows_prehistory(system: str, excitation: str) -> bool:
    """Whether experiments.csv can state that a system had settled under the first excitation."""
    try:
        conditions = system_class(system).conditions or {}
    except UserError:  # other checks report a wrong system name
        return False
    return "prehistory" in conditions.get(COMMANDS.get(excitation, excitation), {})


def value_before(row: ExperimentRow, system: str) -> float | None:
    """Excitation before the first sample: 0 for a voltage; None if as in the first sample.

    None applies to a stretch, and to a voltage if the row states equilibrium.
    """
    if COMMANDS.get(row.excitation, row.excitation) != "voltage":
        return None
    settled = row.metadata.get("prehistory") == "equilibrium"
    return None if settled and knows_prehistory(system, row.excitation) else 0.0


def is_near(first: float, before: float, excitation: FloatArray) -> bool:
    """Whether the first sample is close to the value before it, compared with the excitation."""
    return abs(first - before) <= NEAR * float(np.max(np.abs(excitation - before)))


WITHIN = 0.25
"""Largest relative error of a stated value; the requested and the real value may differ."""
FEWEST_PASSES = 3
PER_PERIOD = 4.0
"""Fewest samples per period; with only two, a sine can look like another one."""
RAMPED, FEWEST_SAMPLES = ("relaxation", "load_unload"), 3
"""Protocols whose excitation begins with one ramp, and the fewest samples for its rate."""


def contradictions(row: ExperimentRow, raw: RawRecord, specimen: Specimen, where: str) -> list[str]:
    """Faults: stated frequency, rate, amplitude or duration that contradicts the record.

    Typical causes are a time in milliseconds, a sine sampled too slowly, or another unit.
    """
    if "time" not in raw.columns or row.excitation not in raw.columns:
        return []
    time, driven = raw.columns["time"], raw.columns[row.excitation]
    if is_step_from_the_start(row.protocol, driven, raw.units[row.excitation]):
        return []
    found = _too_seldom(row, time, where)
    for name, (unit, value) in _VALUES.items():
        stated = row.metadata.get(name)
        if found or not isinstance(stated, int | float) or not 0.0 < stated < np.inf:
            continue
        seen = value(row, time, driven, specimen)
        if seen is not None and abs(seen / stated - 1.0) > WITHIN:
            found.append(
                f"{where}: {name} of experiments.csv is {stated:g}, and the record has "
                f"{with_unit(seen, unit, digits=3)}; correct the one that is wrong: the row, or "
                f"the unit of the record's time or {row.excitation}"
            )
    return found


def _too_seldom(row: ExperimentRow, time: FloatArray, where: str) -> list[str]:
    stated = row.metadata.get("frequency_Hz")
    interval = float(np.median(np.diff(time)))
    if row.protocol != "sine" or not isinstance(stated, int | float) or stated <= 0.0:
        return []
    if 1.0 / stated >= PER_PERIOD * interval:
        return []
    return [
        f"{where}: frequency_Hz of experiments.csv is {stated:g}, and a sample comes every "
        f"{with_unit(interval, 's', digits=3)}: fewer than {PER_PERIOD:g} a period, so that what "
        "the record shows may be another frequency; record it faster, or correct the row or the "
        "unit of time"
    ]


def _frequency(
    row: ExperimentRow, time: FloatArray, driven: FloatArray, of: Specimen
) -> float | None:
    times = passes(time, driven) if row.protocol == "sine" else np.empty(0)
    return 1.0 / float(usual_period(times)) if times.size >= FEWEST_PASSES else None


def _rate(row: ExperimentRow, time: FloatArray, driven: FloatArray, of: Specimen) -> float | None:
    """Stretch rate between a tenth and nine tenths of the largest departure."""
    gauge = of.quantities.get("gauge_length")
    if row.protocol not in RAMPED or row.excitation not in ("stretch", "displacement"):
        return None
    length = 1.0 if row.excitation == "stretch" else gauge and gauge.value
    gone = np.abs(driven - driven[0])
    low, high = (int(np.argmax(gone >= share * gone.max())) for share in (0.1, 0.9))
    if not length or high - low < FEWEST_SAMPLES:
        return None
    return float(gone[high] - gone[low]) / float(time[high] - time[low]) / length


def _amplitude(
    row: ExperimentRow, time: FloatArray, driven: FloatArray, of: Specimen
) -> float | None:
    driven_by_voltage = row.excitation == "voltage" and row.protocol == "sine"
    return 0.5 * float(np.ptp(driven)) / 1e3 if driven_by_voltage else None


def _duration(
    row: ExperimentRow, time: FloatArray, driven: FloatArray, of: Specimen
) -> float | None:
    return float(np.ptp(time))


Value = Callable[[ExperimentRow, FloatArray, FloatArray, Specimen], float | None]
_VALUES: Mapping[str, tuple[str, Value]] = {
    "frequency_Hz": ("Hz", _frequency),
    "stretch_rate_per_s": ("1/s", _rate),
    "amplitude_kV": ("kV", _amplitude),
    "duration_s": ("s", _duration),
}
"""Column of experiments.csv -> its unit, and a function for its value in the record."""
