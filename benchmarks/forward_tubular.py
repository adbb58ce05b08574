"""Forward model of tubular creep against scipy's RK45, per draw, in one run.

    OMP_NUM_THREADS=1 python benchmarks/forward_tubular.py

Both compute the strain of a two-unit chain at 5000 samples of a 0.5 s record, for the
voltage as it is recorded (a knot per sample, with the monitor's 0.3 V of noise) and for
an ideal one that rises within one sample. RK45 (what MATLAB's ode45 is) gets the loosest
tolerance that brings its error below 1e-6 of the range; ours is exact. Medians.
The ideal voltage leaves RK45 a smooth ODE that needs few steps: the target is meant
for histories as they are measured, and for the model with circuit and inertia.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from deabayes.experiment import Excitation, Quantity, Specimen
from deabayes.systems.electrostatics import maxwell_pressure
from deabayes.systems.tubular.system import Tubular

SAMPLES, DRAWS, TARGET, ACCURACY = 5000, 256, 1000, 1e-6
TIME = 1e-4 * np.arange(SAMPLES)
SPECIMEN = Specimen(
    "benchmark",
    "tubular",
    {"kind": "simulated"},
    {"thickness": Quantity(80e-6, "m"), "relative_permittivity": Quantity(3.1, "1")},
)
MEDIANS = {"E_0": 1.5e6, "E_1": 12e6, "E_2": 6e6, "tau_1": 6e-3, "tau_2": 0.12}


def excitations(rng: np.random.Generator) -> dict[str, Excitation]:
    """The recorded and the ideal voltage."""
    charging = np.minimum(114.5 + 120e-3 / 180e-9 * TIME, 2000.0)
    recorded = charging + 0.3 * rng.standard_normal(SAMPLES)
    ideal = np.array([0.0, 1e-4, TIME[-1]]), np.array([0.0, 2000.0, 2000.0])
    return {
        "as recorded": Excitation("voltage", "V", TIME, recorded),
        "ideal": Excitation("voltage", "V", *ideal),
    }


def rk45(excitation: Excitation, draw: dict[str, float], tolerance: float) -> np.ndarray:
    """Strain (N,) by adaptive Runge-Kutta."""

    def slope(t: float, x: np.ndarray) -> list[float]:
        voltage = np.interp(t, excitation.coordinate, excitation.values)
        pressure = maxwell_pressure(voltage, 80e-6, 3.1)
        return [
            (pressure / draw["E_1"] - x[0]) / draw["tau_1"],
            (pressure / draw["E_2"] - x[1]) / draw["tau_2"],
        ]

    pressure = maxwell_pressure(excitation.at(TIME), 80e-6, 3.1)
    solution = solve_ivp(
        slope, (0.0, TIME[-1]), [0.0, 0.0], t_eval=TIME, rtol=tolerance, atol=tolerance * 1e-3
    )
    return pressure / draw["E_0"] + solution.y.sum(axis=0)


def loosest_tolerance(
    excitation: Excitation, draw: dict[str, float], exact: np.ndarray
) -> tuple[float, float]:
    """The tolerance of RK45 that is accurate enough, and its error."""
    for tolerance in 10.0 ** -np.arange(4, 12):
        error = np.max(np.abs(rk45(excitation, draw, tolerance) - exact)) / np.ptp(exact)
        if error <= ACCURACY:
            return float(tolerance), float(error)
    raise RuntimeError("RK45 does not reach the accuracy")


def seconds(run: Callable[[], object], repeats: int) -> float:
    """Median wall time of one call."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def main() -> None:
    rng = np.random.default_rng(1)
    draws = {name: m * np.exp(0.1 * rng.standard_normal(DRAWS)) for name, m in MEDIANS.items()}
    first = {name: float(values[0]) for name, values in draws.items()}
    system = Tubular("voigt_kelvin_2", SPECIMEN)
    print(f"tubular creep, 2 units, {SAMPLES} samples, {DRAWS} draws; ms per draw")
    for label, excitation in excitations(rng).items():
        simulate = system.simulator(excitation, TIME, "strain")
        tolerance, error = loosest_tolerance(excitation, first, simulate(draws)[0])
        ours = seconds(lambda run=simulate: run(draws), 21) / DRAWS
        theirs = seconds(lambda e=excitation, t=tolerance: rk45(e, first, t), 5)
        print(
            f"  voltage {label}: RK45 {1e3 * theirs:.3f} (rtol {tolerance:g}, error {error:.0e}),"
        )
        print(f"    deabayes {1e3 * ours:.4f}, ratio {theirs / ours:.0f}; target {TARGET}")
    grid = np.geomspace(6e-3, 0.49, 220)
    prepared = system.simulator(excitations(rng)["ideal"], grid, "strain")
    print(
        f"  {grid.size} prepared points: {1e3 * seconds(lambda: prepared(draws), 21) / DRAWS:.4f}"
    )


if __name__ == "__main__":
    main()
