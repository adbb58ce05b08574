"""Forward model of the minimum-energy structure against scipy, in one run.

    OMP_NUM_THREADS=1 python -m benchmarks.forward_minimum_energy_structure

Ten periods of the paper's sine of 5 kV at 1, 5 and 10 Hz, sampled at 1 ms, four Maxwell units,
400 outputs, 256 draws. scipy's LSODA and RK45 (what MATLAB's ode45 is) get the loosest
tolerance that brings their error below 1e-6 of the range, with the film's law evaluated for
each draw as the equation is written, and with that of one term. Ours runs at its default
tolerance; its error is printed.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from tests.shared import structures

from deabayes.experiment import Excitation, FloatArray

DRAWS, POINTS, PERIODS, TARGET, ACCURACY = 256, 400, 10, 300, 1e-6
UNITS = 4
LENGTH, REST, SECTION = 0.067, np.pi / 4.0, 1.5e-3 * 4e-5


def sine(frequency: float) -> Excitation:
    """The paper's (1), sampled at 1 ms."""
    knots = np.arange(0.0, PERIODS / frequency + 5e-4, 1e-3)
    volts = 2750.0 - 2250.0 * np.cos(2.0 * np.pi * frequency * knots)
    return structures.voltage(knots, volts)


def scipy_angle(
    draw: dict[str, float], frequency: float, times: FloatArray, method: str, tolerance: float
) -> FloatArray:
    """theta (N,) by one of scipy's solvers; states theta, theta'/100 and 100 x_i."""
    held = structures.structure().structure({n: np.array([v]) for n, v in draw.items()})
    electric, hinge = held.electric[0], held.hinge[0]
    weight, inertia, turning = held.weight[0], held.inertia[0], held.turning[0]
    mu, alpha = ([draw[f"{name}_{i}"] for i in range(1, 5)] for name in ("mu", "alpha"))
    mu, alpha = np.array(mu), np.array(alpha)
    k = np.array([draw[f"k_{i}"] for i in range(1, UNITS + 1)])
    tau = np.array([draw[f"tau_{i}"] for i in range(1, UNITS + 1)])

    def slope(t: float, y: FloatArray) -> FloatArray:
        angle, omega, x = y[0], 100.0 * y[1], y[2:] / 100.0
        sine, cosine = np.sin(angle), np.cos(angle)
        volts = 2750.0 - 2250.0 * np.cos(2.0 * np.pi * frequency * t)
        film = SECTION * np.dot(mu, (5.0 * cosine) ** alpha - (25.0 * cosine) ** -alpha)
        rate = -LENGTH * sine * omega
        moment = film * sine / cosine - weight * cosine - hinge * angle
        moment += LENGTH * sine * (np.dot(k, x) + draw["eta_0"] * rate)
        moment -= sine * cosine * (electric * volts**2 + turning * omega**2)
        speed = moment / (inertia + turning * sine**2)
        return np.concatenate([[omega, speed / 100.0], 100.0 * (rate - x / tau)])

    start = np.zeros(UNITS + 2)
    start[0] = REST
    solution = solve_ivp(
        slope, (0.0, times[-1]), start, method, times, rtol=tolerance, atol=1e-2 * tolerance
    )
    return np.asarray(solution.y[0])


def loosest(
    draw: dict[str, float], frequency: float, times: FloatArray, method: str, exact: FloatArray
) -> tuple[float, float]:
    """Seconds at the loosest tolerance that is accurate enough, and that tolerance."""
    for tolerance in 10.0 ** -np.arange(3, 12):
        begin = time.perf_counter()
        angle = scipy_angle(draw, frequency, times, method, tolerance)
        spent = time.perf_counter() - begin
        moved = LENGTH * (np.cos(angle) - np.cos(REST))
        if np.max(np.abs(moved - exact)) <= ACCURACY * np.ptp(exact):
            return spent, float(tolerance)
    raise RuntimeError(f"{method} does not reach the accuracy")


def seconds(run: Callable[[], object], repeats: int = 7) -> float:
    """Median wall time of one call, after one that compiles."""
    run()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        run()
        times.append(time.perf_counter() - begin)
    return float(np.median(times))


def main() -> None:
    """Print the table."""
    draws = structures.spread_draws(UNITS, DRAWS)
    first = {name: float(values[0]) for name, values in draws.items()}
    alone = {name: values[:1] for name, values in draws.items()}
    print(f"minimum-energy structure, {UNITS} units, {PERIODS} periods, {DRAWS} draws; ms per draw")
    for frequency in (1.0, 5.0, 10.0):
        driven, times = sine(frequency), np.linspace(0.0, PERIODS / frequency, POINTS)
        simulate = structures.structure().simulator(driven, times, "displacement")
        smooth = structures.sine(frequency, PERIODS, per_period=4000)
        exact = structures.structure(tolerance=1e-10).predict(smooth, times, "displacement", alone)[
            0
        ]
        error = np.max(np.abs(simulate(alone)[0] - exact)) / np.ptp(exact)
        ours = seconds(lambda run=simulate: run(draws)) / DRAWS
        print(f"  {frequency:g} Hz: deabayes {1e3 * ours:.4f} (error {error:.0e})", end="")
        for method in ("LSODA", "RK45"):
            theirs, tolerance = loosest(first, frequency, times, method, exact)
            ratio = f"ratio {theirs / ours:.0f}"
            print(f"; {method} {1e3 * theirs:.0f} (rtol {tolerance:g}), {ratio}", end="")
        print(f"; target {TARGET}")


if __name__ == "__main__":
    main()
