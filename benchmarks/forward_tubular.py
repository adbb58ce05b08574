"""Forward model of the tubular actuator against scipy's RK45, in one run.

    OMP_NUM_THREADS=1 python -m benchmarks.forward_tubular

Strain of a two-unit chain at 5000 samples of 0.5 s, alone, with mass, and with mass and circuit:
for the amplifier's voltage as it is recorded (a knot per sample, with the monitor's 0.3 V of
noise), and for an ideal one, which leaves RK45 a smooth equation of few steps. RK45 (what
MATLAB's ode45 is) gets the loosest tolerance that brings its error below 1e-6 of the range;
ours is exact. Medians. Then the same models on an uneven grid, where steps share no
propagators.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from tests.shared import tubes

from deabayes.experiment import Excitation, FloatArray, Quantity, Specimen
from deabayes.systems.electrostatics import maxwell_pressure
from deabayes.systems.tubular.system import Tubular

SAMPLES, DRAWS, TARGET, ACCURACY = 5000, 256, 1000, 1e-6
TIME = 1e-4 * np.arange(SAMPLES)
MEDIANS = {"E_0": 1.5e6, "E_1": 12e6, "E_2": 6e6, "tau_1": 6e-3, "tau_2": 0.12}
INERTIA = 9.724166666666669
CIRCUIT = {"series_resistance": 954.0, "leakage_resistance": 1e9, "capacitance": 180e-9}
QUANTITIES = {
    **tubes.QUANTITIES,
    "series_resistance": Quantity(CIRCUIT["series_resistance"], "ohm"),
    "leakage_resistance": Quantity(CIRCUIT["leakage_resistance"], "ohm"),
    "capacitance": Quantity(CIRCUIT["capacitance"], "F"),
}
SPECIMEN = Specimen("benchmark", "tubular", {"kind": "simulated"}, QUANTITIES)


def excitations(rng: np.random.Generator) -> dict[str, Excitation]:
    """A step to 2 kV by an amplifier of limited current: as its monitor shows it, and ideal."""
    charging = np.minimum(114.5 + 120e-3 / 180e-9 * TIME, 2000.0)
    noisy = charging + 0.3 * rng.standard_normal(SAMPLES)
    ideal = np.array([0.0, 3e-3, TIME[-1]]), np.array([0.0, 2000.0, 2000.0])
    return {
        "as recorded": Excitation("voltage", "V", TIME, noisy),
        "ideal": Excitation("voltage", "V", *ideal),
    }


def rk45(
    excitation: Excitation, draw: dict[str, float], system: Tubular, tolerance: float
) -> FloatArray:
    """Strain (N,) by adaptive Runge-Kutta; states S, S' / 400, x_1, x_2 and v_C / 1e5."""
    knots, volts, scale = excitation.coordinate, excitation.values, 1e5
    leak, rate = 1.0 / CIRCUIT["leakage_resistance"], 400.0
    e_0, e_1, e_2, t_1, t_2 = draw.values()
    circuit = system.circuit

    def slope(t: float, y: FloatArray) -> list[float]:
        voltage = charging = np.interp(t, knots, volts)
        if circuit:
            voltage = scale * y[4]
            current = (charging - voltage) / CIRCUIT["series_resistance"] - voltage * leak
            charging = current / CIRCUIT["capacitance"] / scale
        stress = e_0 * (y[0] - y[2] - y[3])
        pressure = 8.8541878188e-12 * 3.1 * (voltage / 80e-6) ** 2
        motion = [rate * y[1], (pressure - stress) / INERTIA / rate]
        motion += [(stress / e_1 - y[2]) / t_1, (stress / e_2 - y[3]) / t_2]
        return [*motion, charging] if circuit else motion

    def creep(t: float, x: FloatArray) -> list[float]:
        pressure = maxwell_pressure(np.interp(t, knots, volts), 80e-6, 3.1)
        return [(pressure / e_1 - x[0]) / t_1, (pressure / e_2 - x[1]) / t_2]

    massless = system.massless
    start = [0.0] * (2 if massless else 5 if circuit else 4)
    solution = solve_ivp(
        creep if massless else slope,
        (0.0, TIME[-1]), start, t_eval=TIME, rtol=tolerance, atol=tolerance * 1e-3,
    )  # fmt: skip
    if massless:
        return maxwell_pressure(excitation.at(TIME), 80e-6, 3.1) / e_0 + solution.y.sum(axis=0)
    return np.asarray(solution.y[0])


def loosest_tolerance(
    excitation: Excitation, draw: dict[str, float], system: Tubular, exact: FloatArray
) -> tuple[float, float]:
    """The tolerance of RK45 that is accurate enough, and its error."""
    for tolerance in 10.0 ** -np.arange(3, 11):
        strain = rk45(excitation, draw, system, tolerance)
        error = np.max(np.abs(strain - exact)) / np.ptp(exact)
        if error <= ACCURACY:
            return float(tolerance), float(error)
    raise RuntimeError("RK45 does not reach the accuracy")


def seconds(run: Callable[[], object], repeats: int) -> float:
    """Median wall time of one call, after one that compiles."""
    run()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def compare(system: Tubular, excitation: Excitation, draws: dict[str, FloatArray]) -> None:
    """Print one record's times and their ratio."""
    simulate = system.simulator(excitation, TIME, "strain")
    first = {name: float(values[0]) for name, values in draws.items()}
    exact = simulate(draws)[0]
    tolerance, error = loosest_tolerance(excitation, first, system, exact)
    ours = seconds(lambda: simulate(draws), 11) / DRAWS
    theirs = seconds(lambda: rk45(excitation, first, system, tolerance), 1)
    print(f"RK45 {1e3 * theirs:.1f} (rtol {tolerance:g}, error {error:.0e}),")
    print(f"    deabayes {1e3 * ours:.4f}, ratio {theirs / ours:.0f}; target {TARGET}")


def main() -> None:
    """Print the table."""
    rng = np.random.default_rng(1)
    draws = {name: m * np.exp(0.1 * rng.standard_normal(DRAWS)) for name, m in MEDIANS.items()}
    given, uneven = excitations(rng), np.geomspace(6e-3, 0.49, 220)
    print(f"tubular actuator, 2 units, {SAMPLES} samples, {DRAWS} draws; ms per draw")
    endings = {"chain": "", "mass": "_inertia", "mass and circuit": "_inertia_circuit"}
    for label, ending in endings.items():
        system = Tubular(f"voigt_kelvin_2{ending}", SPECIMEN)
        for name, excitation in given.items():
            print(f"  {label}, voltage {name}: ", end="")
            compare(system, excitation, draws)
        prepared = system.simulator(given["ideal"], uneven, "strain")
        spent = seconds(lambda run=prepared: run(draws), 11) / DRAWS
        print(f"  {label}, {uneven.size} points on an uneven grid: {1e3 * spent:.4f}")


if __name__ == "__main__":
    main()
