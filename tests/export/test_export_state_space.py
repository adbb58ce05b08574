"""Exported matrices against the forward model, the closed forms and scipy."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.signal import cont2discrete
from tests.shared.tube_trees import specimen, tree

from deabayes.experiment import Excitation, Quantity
from deabayes.export import export
from deabayes.export.source import evenly
from deabayes.posteriors.storage import stacked
from deabayes.systems import build
from deabayes.systems.tubular.circuit import Circuit
from deabayes.systems.tubular.sine import SineResponse, fundamental_pressure
from deabayes.systems.tubular.voigt_kelvin import Chain, MovingChain

ENDINGS = ("1", "2", "2_inertia", "2_circuit", "2_inertia_circuit")
CANDIDATES = [f"voigt_kelvin_{ending}" for ending in ENDINGS]
FREQUENCY = np.geomspace(0.1, 2000.0, 150)


def exported(posterior, folder, **options):
    export(posterior, "state-space", folder / "model.json", **options)
    return json.loads((folder / "model.json").read_text())


def matrices(model, which="continuous"):
    return tuple(np.array(model[which][name]) for name in "ABCD")


def draws_of(model):
    return {n: np.array(p["values"]) for n, p in model["draws"]["parameters"].items()}


def transfer(model):
    a, b, c, d = matrices(model)
    s = 2j * np.pi * FREQUENCY[:, None, None]
    states = np.linalg.solve(s * np.eye(a.shape[1]) - a[:, None], np.broadcast_to(
        b[:, None], (len(b), FREQUENCY.size, *b.shape[1:])))  # fmt: skip
    return (c[:, None] @ states + d[:, None])[:, :, 0, 0]


def parts(model, load=0.0):
    """Chain, moving chain, circuit and pressure per square of the exported draws."""
    draws, quantities = draws_of(model), specimen().quantities
    held = {n: np.broadcast_to(draws.get(n, q.value), draws["E_0"].shape)
            for n, q in quantities.items()}  # fmt: skip
    chain = Chain.from_draws(draws, 2)
    moving = held["active_mass"] + 0.5 * (held["total_mass"] - held["active_mass"])
    mass = (moving + held["sensor_mass"] + load) * held["active_length"] / held["cross_section"]
    circuit = Circuit(
        *(held[n] for n in ("series_resistance", "leakage_resistance", "capacitance"))
    )
    per_square = 8.8541878188e-12 * held["relative_permittivity"] / held["thickness"] ** 2
    return chain, MovingChain(chain, mass), circuit, per_square


def sampled(model, inputs):
    """Output (draw, sample) of the discrete model, from rest."""
    a, b, c, d = matrices(model, "discrete")
    state, output = np.zeros_like(b), []
    for value in inputs:
        output.append((c @ state + d * value)[:, 0, 0])
        state = a @ state + b * value
    return np.array(output).T


@pytest.mark.parametrize(
    "candidate", ["voigt_kelvin_1", "voigt_kelvin_2", "voigt_kelvin_2_inertia"]
)
def test_the_discrete_model_predicts_as_the_system_does(candidate, tmp_path):
    """Voltages that jump every two samples; strain at every sample."""
    load = 300.0 if "inertia" in candidate else None
    model = exported(tree(candidate), tmp_path, rate="1 kHz", load_g=load)
    voltage = np.repeat(np.random.default_rng(0).uniform(0.0, 2500.0, 60), 2)
    time = 1e-3 * np.arange(voltage.size)
    knots, values = np.repeat(time, 2)[1:], np.repeat(voltage, 2)[:-1]
    driven = Excitation("voltage", "V", knots, values, {"load_g": load or 0.0})
    wanted = build("tubular", candidate, specimen()).predict(
        driven, time, "strain", draws_of(model)
    )
    got = sampled(model, voltage**2)
    np.testing.assert_allclose(got, wanted, rtol=0.0, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("ending", ["", "_circuit"])
@pytest.mark.parametrize("load", [0.0, 300.0])
def test_transfer_function_of_the_squared_voltage(ending, load, tmp_path):
    """Whether or not there is a circuit: the square is that of the electrodes' voltage."""
    model = exported(tree(f"voigt_kelvin_2_inertia{ending}"), tmp_path, load_g=load)
    _, moving, _, per_square = parts(model, 1e-3 * load)
    wanted = per_square[:, None] * moving.transfer(2j * np.pi * FREQUENCY)
    np.testing.assert_allclose(transfer(model), wanted, rtol=1e-10)
    assert model["input"]["name"] == "voltage_squared" and model["load"]["value"] == 1e-3 * load
    assert ("behind the circuit" in model["validity"]) == bool(ending)


def test_linearised_gain_is_the_biased_sines_fundamental(tmp_path):
    model = exported(tree("voigt_kelvin_2_inertia_circuit"), tmp_path, bias="2 kV", load_g=100.0)
    _, moving, circuit, per_square = parts(model, 0.1)
    wanted = SineResponse(circuit, moving, per_square).harmonic(2000.0, FREQUENCY)
    np.testing.assert_allclose(transfer(model), wanted, rtol=1e-9)
    assert model["input"] | {"description": ""} == {
        "name": "voltage_deviation", "unit": "V", "description": ""}  # fmt: skip
    assert [state["unit"] for state in model["states"]] == ["1", "1/s", "1", "1", "V"]


def test_linearised_gain_without_mass(tmp_path):
    model = exported(tree("voigt_kelvin_2_circuit"), tmp_path, bias="2 kV")
    chain, _, circuit, per_square = parts(model)
    pressure = fundamental_pressure(circuit, 1.0, 2000.0, FREQUENCY, per_square)
    wanted = pressure * chain.complex_compliance(2j * np.pi * FREQUENCY)
    np.testing.assert_allclose(transfer(model), wanted, rtol=1e-9)


@pytest.mark.parametrize("candidate", CANDIDATES)
def test_operating_point_is_where_the_system_settles(candidate, tmp_path):
    model = exported(tree(candidate), tmp_path, bias="2 kV")
    point = model["operating_point"]
    driven = Excitation("voltage", "V", np.zeros(1), np.full(1, 2000.0))
    system = build("tubular", candidate, specimen())
    settled = system.predict(driven, np.array([30.0]), "strain", draws_of(model))[:, 0]
    np.testing.assert_allclose(point["strain"]["values"], settled, rtol=1e-9)
    assert point["bias"]["values"] == 2000.0
    ratio = np.array(point["capacitor_voltage"]["values"]) / 2000.0
    assert np.all(ratio < 0.9999) if "circuit" in candidate else np.all(ratio == 1.0)


@pytest.mark.parametrize("bias", [None, "1.5 kV"])
@pytest.mark.parametrize("candidate", CANDIDATES)
def test_discrete_is_the_zero_order_hold(candidate, bias, tmp_path):
    model = exported(tree(candidate), tmp_path, rate="2 kHz", bias=bias)
    assert model["discrete"]["sample_time"] == {"unit": "s", "value": 0.0005}
    assert "zero-order hold" in model["discrete"]["discretisation"]
    held = zip(*matrices(model, "discrete"), strict=True)
    for got, system in zip(held, zip(*matrices(model), strict=True), strict=True):
        wanted = cont2discrete(system, 0.0005, method="zoh")[:4]
        for one, other in zip(got, wanted, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12 * np.abs(other).max())


def test_matlab_and_json_hold_the_same_numbers(tmp_path):
    posterior = tree("voigt_kelvin_2_inertia_circuit")
    options = {"rate": "10 kHz", "bias": "2 kV", "load_g": 300.0, "draws": 5}
    model = exported(posterior, tmp_path, **options)
    export(posterior, "state-space", tmp_path / "model.mat", **options)
    matlab = loadmat(tmp_path / "model.mat", simplify_cells=True)["model"]
    for which in ("continuous", "discrete"):
        for name, got in zip("ABCD", matrices(model, which), strict=True):
            assert np.array_equal(np.moveaxis(got, 0, -1).squeeze(), matlab[which][name].squeeze())
    assert matlab["continuous"]["A"].shape == (5, 5, 5)
    assert matlab["discrete"]["sample_time"]["value"] == model["discrete"]["sample_time"]["value"]
    assert [s["name"] for s in matlab["states"]] == [s["name"] for s in model["states"]]
    assert np.array_equal(draws_of(model)["E_1"], matlab["draws"]["parameters"]["E_1"]["values"])
    assert matlab["provenance"] == "simulated" and matlab["converged"]


def test_a_model_says_where_it_comes_from(tmp_path):
    model = exported(tree("voigt_kelvin_2", converged=False), tmp_path)
    assert model["candidate"] == "voigt_kelvin_2" and model["system"] == "tubular"
    assert "simulated" in model["provenance_note"] and model["deabayes_version"] == "0.1.0"
    assert model["converged"] is False and model["sensor_delay"]["value"] == 4e-4
    assert "discrete" not in model and model["operating_point"] == {}


@pytest.mark.parametrize("channel", ["delay", "displacement.delay", "strain.delay"])
def test_the_sensors_delay_is_told_wherever_it_is_stated(channel, tmp_path):
    late = {"current.delay": Quantity(7e-4, "s"), channel: Quantity(3e-4, "s")}
    posterior = tree("voigt_kelvin_2", of=replace(specimen(), instruments=late))
    assert exported(posterior, tmp_path)["sensor_delay"]["value"] == 3e-4


@pytest.mark.parametrize("sd", [None, 5e-5])
def test_a_modelled_delay_is_told(sd, tmp_path):
    quantities = specimen().quantities | {"sensor_delay": Quantity(3e-4, "s", sd)}
    late = replace(specimen(), quantities=quantities, instruments={})
    model = exported(tree("voigt_kelvin_2", of=late), tmp_path)
    assert model["sensor_delay"]["value"] == 3e-4 and model["sensor_delay"].get("sd") == sd
    assert ("sensor_delay" in draws_of(model)) == (sd is not None)
    without = replace(specimen(), instruments={"current.delay": Quantity(7e-4, "s")})
    assert "sensor_delay" not in exported(tree("voigt_kelvin_2", of=without), tmp_path)


def test_draws_are_taken_evenly_and_can_be_found_again(tmp_path):
    posterior = tree("voigt_kelvin_2", size=20)
    model = exported(posterior, tmp_path, draws=8)
    assert model["draws"]["ensemble"] == [0] * 4 + [1] * 4
    assert model["draws"]["draw"] == [2, 7, 12, 17] * 2
    rows = 20 * np.array(model["draws"]["ensemble"]) + np.array(model["draws"]["draw"])
    assert np.array_equal(draws_of(model)["tau_1"], stacked(posterior["posterior"], "tau_1")[rows])
    assert np.array_equal(evenly(40, 40), np.arange(40))
    assert len(exported(tree("voigt_kelvin_2", size=200), tmp_path)["draws"]["draw"]) == 200
