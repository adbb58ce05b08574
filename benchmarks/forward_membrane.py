"""Forward model of the membrane against scipy's RK45 at equal accuracy, in one run.

    OMP_NUM_THREADS=1 python benchmarks/forward_membrane.py

kv_gm_3 with the paper's parameters: a 4 kV step (600 s, 1500 points) and the alternating
case (2 kV at 0.05 Hz, 600 s, 2000 points, the voltage sampled 400 times a period). Ours: 256
draws scattered by 10 % about them, per draw, through a simulator (what the
likelihood calls) and through
`deabayes.simulate`. RK45 (what MATLAB's ode45 is) and others: the central draw, at the
loosest tolerance whose error is within 1e-6 of the range. Best of several timings.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

import deabayes
from deabayes.experiment import Excitation, FloatArray, Quantity, Specimen
from deabayes.systems.membrane.system import Membrane

WALKERS, ACCURACY = 256, 1e-6
TARGETS = {"step": (5000, 1000), "alternating": (1000, 1000)}
"""Ratio to RK45 of the kernel and of `deabayes.simulate` (the latter stated for the step)."""
QUANTITIES = {
    "thickness": Quantity(1e-3, "m"),
    "permittivity": Quantity(4.11e-11, "F/m"),
    "prestretch": Quantity(3.0, "1"),
}
SPECIMEN = Specimen("benchmark", "membrane", {"kind": "simulated"}, QUANTITIES)
STEP = {"mu_alpha": 35e3, "zeta_alpha": 1e5, "J_alpha": 110.0, "J_beta": 55.0,
        "mu_beta_1": 15e3, "mu_beta_2": 15e3, "mu_beta_3": 15e3,
        "tau_beta_1": 4.0, "tau_beta_2": 33.5, "tau_beta_3": 83.5}  # fmt: skip
SINE = STEP | {"zeta_alpha": 7.5e4, "mu_beta_1": 65.217e3, "mu_beta_2": 46.154e3,
               "mu_beta_3": 10e3, "tau_beta_1": 46.0, "tau_beta_2": 65.0,
               "tau_beta_3": 300.0}  # fmt: skip
PEERS = {
    "RK45": np.arange(4.0, 12.0, 0.5),
    "LSODA": np.arange(6.0, 12.0, 0.5),
    "Radau": np.arange(5.0, 11.0, 0.5),
}
"""Methods and the negative exponents of the tolerances to try."""


def cases() -> dict[str, tuple[dict[str, float], Excitation, FloatArray, Callable[[float], float]]]:
    """Parameters, excitation, output times and the voltage as a function."""
    knots = np.linspace(0.0, 600.0, 30 * 400 + 1)
    alternating = 2e3 * np.sin(0.1 * np.pi * knots)
    ends = np.array([0.0, 600.0])
    return {
        "step": (
            STEP,
            Excitation("voltage", "V", ends, np.array([4e3, 4e3])),
            np.linspace(0.0, 600.0, 1500),
            lambda t: 4e3 + 0.0 * t,
        ),
        "alternating": (
            SINE,
            Excitation("voltage", "V", knots, alternating),
            np.linspace(0.0, 600.0, 2000),
            lambda t: 2e3 * np.sin(0.1 * np.pi * t),
        ),
    }


def peer(
    method: str, tolerance: float, values: dict[str, float], volts: Callable[[float], float],
    times: FloatArray,
) -> FloatArray:  # fmt: skip
    """Stretch (N,) of one draw by scipy."""
    mu = np.array([values[f"mu_beta_{i}"] for i in (1, 2, 3)])
    tau = np.array([values[f"tau_beta_{i}"] for i in (1, 2, 3)])
    j_alpha, j_beta = values["J_alpha"], values["J_beta"]

    def alpha(lam: float) -> float:
        argument = 1.0 - (2.0 * lam**2 + lam**-4 - 3.0) / j_alpha
        return values["mu_alpha"] * (lam - lam**-5) / argument

    prestress = alpha(3.0)

    def flow(t: float, y: FloatArray) -> FloatArray:
        lam, xi = y[0], y[1:]
        argument = 1.0 - (2.0 * lam**2 / xi**2 + xi**4 / lam**4 - 3.0) / j_beta
        total = 4.11e-5 * volts(t) ** 2 * lam**3 + prestress - alpha(lam)
        total -= mu @ ((lam / xi**2 - xi**4 / lam**5) / argument)
        rates = (lam**2 / xi**3 - xi**3 / lam**4) / argument / tau
        return np.concatenate([[total / values["zeta_alpha"]], rates])

    return np.asarray(
        solve_ivp(
            flow, (0.0, 600.0), np.full(4, 3.0), method, times,
            rtol=10.0**-tolerance, atol=10.0**-tolerance,
        ).y[0]
    )  # fmt: skip


def best(run: Callable[[], object], repeats: int) -> float:
    """Shortest of several timings [s]."""
    timings = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        timings.append(time.perf_counter() - start)
    return min(timings)


def kernel_alone(
    system: Membrane, excitation: Excitation, times: FloatArray, draws: dict[str, FloatArray]
) -> Callable[[], None]:
    """The compiled integration, with its constants prepared."""
    from deabayes.systems.membrane.kernel import integrate

    history = system._history(excitation, times)
    limit = np.full(WALKERS, system.breakdown)
    constants = system._material(draws).constants(history, system.tolerance, limit)
    pieces = history.edges, history.coefficients, history.restart
    stretch = np.empty((WALKERS, times.size))
    steps, ended = np.empty(WALKERS, dtype=np.int64), np.empty(WALKERS)
    return lambda: integrate(*pieces, times, *constants, stretch, steps, ended)


def time_case(
    name: str,
    values: dict[str, float],
    excitation: Excitation,
    times: FloatArray,
    volts: Callable[[float], float],
) -> None:
    """Print one case's table."""
    rng = np.random.default_rng(1)
    draws = {k: v * np.exp(0.1 * rng.standard_normal(WALKERS)) for k, v in values.items()}
    for k, v in values.items():
        draws[k][0] = v
    system = Membrane("kv_gm_3", SPECIMEN)
    simulate = system.simulator(excitation, times, "stretch")
    exact = Membrane("kv_gm_3", SPECIMEN, 1e-9).predict(excitation, times, "stretch", draws)
    error = np.max(np.max(np.abs(simulate(draws) - exact), axis=1) / np.ptp(exact, axis=1))
    own = best(lambda: simulate(draws), 30) / WALKERS
    kernel = best(kernel_alone(system, excitation, times, draws), 30) / WALKERS
    voltage = np.broadcast_to(volts(times), times.shape)
    quantities = {name: quantity.value for name, quantity in QUANTITIES.items()}
    whole = best(lambda: deabayes.simulate(
        "membrane", "kv_gm_3", draws, quantities, time=times, voltage=voltage
    ), 30) / WALKERS  # fmt: skip
    print(f"\n{name}: {times.size} points, {WALKERS} draws")
    print(f"{'':<24}{'us per draw':>12}{'worst error':>13}{'over kernel':>12}{'over simulate':>15}")
    print(f"{'deabayes, kernel':<24}{1e6 * kernel:>12.2f}{error:>13.1e}{1:>12}")
    print(f"{'deabayes, simulator':<24}{1e6 * own:>12.2f}{'':>13}{own / kernel:>12.2f}")
    print(f"{'deabayes.simulate':<24}{1e6 * whole:>12.2f}{'':>13}{'':>12}{1:>15}")
    for method, exponents in PEERS.items():
        for exponent in exponents:
            found: list[FloatArray] = []
            elapsed = best(lambda: found.append(peer(method, exponent, values, volts, times)), 2)  # noqa: B023
            miss = np.max(np.abs(found[0] - exact[0])) / np.ptp(exact[0])
            if miss <= ACCURACY:
                break
        label = f"scipy {method} 1e-{exponent:g}"
        print(f"{label:<24}{1e6 * elapsed:>12.0f}{miss:>13.1e}{elapsed / kernel:>12.0f}"
              f"{elapsed / whole:>15.0f}")  # fmt: skip
    print(f"{'target, over RK45':<24}{'':>25}{TARGETS[name][0]:>12}{TARGETS[name][1]:>15}")


def main() -> None:
    """Print the tables."""
    start = time.perf_counter()
    first = Membrane("kv_gm_1", SPECIMEN)
    draws = {p.name: np.ones(1) for p in first.parameters()}
    first.predict(cases()["step"][1], np.ones(1), "stretch", draws)
    print(f"kernels ready in {time.perf_counter() - start:.1f} s (cold or from the cache)")
    for name, case in cases().items():
        time_case(name, *case)


if __name__ == "__main__":
    main()
