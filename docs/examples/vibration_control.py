"""Vibration isolation that is robust over a posterior: python vibration_control.py MODEL.json.

MODEL.json is an export `--to state-space --bias ... --load-g ...` of a candidate with inertia.
"""

import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import control
import matplotlib.pyplot as plt
import numpy as np

DELAY = 0.4e-3  # [s] of the sensor
HIGH_PASS = 2 * np.pi * 0.2  # [rad/s]: below 0.2 Hz the accelerometer's offset is not integrated
LENGTH = 0.07  # [m], active: strain times this is the mass's displacement
FREQUENCY = np.geomspace(0.1, 1000.0, 2000)  # [Hz]
LARGEST_SENSITIVITY = 2.0


def systems(file: str | Path) -> Iterator[tuple[control.StateSpace, control.StateSpace]]:
    """Per draw: voltage to the mass's acceleration, base to mass (both per active length)."""
    model = json.loads(Path(file).read_text(encoding="utf-8"))
    rate = [s["name"] for s in model["states"]].index("strain_rate_deviation")
    for a, b in zip(*(np.array(model["continuous"][m]) for m in "AB"), strict=True):
        row = a[rate : rate + 1]  # of the strain's acceleration
        # On a shaken base that is the mass's own acceleration, the relative one plus the base's.
        shaken = -1.0 * (np.arange(len(b)) == rate)[:, None]
        yield control.ss(a, b, row, b[rate]), control.ss(a, shaken, row, 0.0)


def skyhook() -> control.StateSpace:
    """Acceleration to velocity, with the sensor's delay; times the gain [V s] the feedback."""
    integrator = control.tf([1.0, 0.0], [1.0, 2 * HIGH_PASS, HIGH_PASS**2])
    return control.ss(integrator) * control.ss(control.tf(*control.pade(DELAY, 3)))


def responses(models: Iterable[control.StateSpace]) -> np.ndarray:
    """Complex frequency responses (draw, frequency)."""
    return np.array([m(2j * np.pi * FREQUENCY) for m in models])


def peak_sensitivity(loop: np.ndarray, gain: float | np.ndarray) -> np.ndarray:
    """Ms (draw,): the most by which feedback amplifies a vibration at any frequency."""
    return np.abs(1.0 / (1.0 + gain * loop)).max(axis=1)


def largest_gains(loop: np.ndarray, critical: np.ndarray) -> np.ndarray:
    """The gain (draw,) up to which Ms keeps the limit, by bisection.

    The actuator alone is stable, and on the way to the critical gain (draw,) Ms grows to infinity.
    """
    low, high = np.zeros_like(critical), critical
    for _ in range(20):
        middle = 0.5 * (low + high)
        within = peak_sensitivity(loop, middle[:, None]) <= LARGEST_SENSITIVITY
        low, high = np.where(within, middle, low), np.where(within, high, middle)
    return low


def unstable(plants: Iterable[control.StateSpace], gain: float) -> float:
    """Share of draws whose closed loop has a pole in the right half plane."""
    loops = [control.feedback(plant, gain * skyhook()) for plant in plants]
    return float(np.mean([loop.poles().real.max() >= 0.0 for loop in loops]))


def interval(values: np.ndarray, digits: int) -> str:
    """Median and 90 % interval as text."""
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
    return f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def draw_figure(passive: np.ndarray, active: np.ndarray, output: str, source: str) -> None:
    """Transmissibility of every draw, passive and controlled; `source` says what of."""
    figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
    for curves, colour, label in ((passive, "0.6", "passive"), (active, "C0", "controlled")):
        low, middle, high = np.quantile(curves, [0.05, 0.5, 0.95], axis=0)
        axes.fill_between(FREQUENCY, low, high, color=colour, alpha=0.4, lw=0)
        axes.loglog(FREQUENCY, middle, color=colour, label=label)
    axes.set(xlabel="frequency (Hz)", ylabel="|mass / base acceleration|")
    axes.set_title(f"{source} data", loc="right", color="#D55E00", style="italic", fontsize=9)
    axes.legend(frameon=False, title="median, 90 % interval of the draws")
    figure.savefig(output, dpi=150)


def main(file: str, output: str = "vibration_control.png") -> None:
    """Design, check and draw."""
    plants, bases = zip(*systems(file), strict=True)
    loop, passive = responses([plant * skyhook() for plant in plants]), np.abs(responses(bases))
    resonance = np.arange(len(plants)), passive.argmax(axis=1)
    critical = np.array([control.stability_margins(p * skyhook())[0] for p in plants])
    limits = largest_gains(loop, critical)
    robust, median, bold = limits.min(), np.median(limits), 0.98 * np.median(critical)
    print(f"{len(plants)} draws; gains in V s")
    for name, gain in (("robust", robust), ("median", median), ("bold", bold)):
        beyond = np.mean(peak_sensitivity(loop, gain) > LARGEST_SENSITIVITY)
        lost = unstable(plants, gain)
        print(f"{name} gain {gain:.0f}: Ms over the limit in {beyond:.0%}, unstable in {lost:.0%}")
    active = passive / np.abs(1.0 + robust * loop)
    voltage = robust * np.abs(skyhook()(2j * np.pi * FREQUENCY)) * active / LENGTH
    for name, values, digits in (
        ("Ms", peak_sensitivity(loop, robust), 2),
        ("resonance [Hz]", FREQUENCY[resonance[1]], 1),
        ("base to mass at resonance, passive", passive[resonance], 1),
        ("base to mass at resonance, controlled", active[resonance], 3),
        ("reduction at resonance [dB]", 20 * np.log10(passive[resonance] / active[resonance]), 1),
        ("greatest at any frequency, controlled", active.max(axis=1), 2),
        ("voltage per m/s^2 of the base at resonance [V]", voltage[resonance], 0),
        ("voltage per m/s^2 of the base at 5 Hz [V]", voltage[:, FREQUENCY > 5.0][:, 0], 0),
    ):
        print(f"{name}: {interval(values, digits)}")
    source = json.loads(Path(file).read_text(encoding="utf-8"))["provenance"]
    draw_figure(passive, active, output, source)


if __name__ == "__main__":
    main(*sys.argv[1:])
