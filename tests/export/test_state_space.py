"""Exported matrices against the forward model, closed forms and scipy; refusals; the command."""

from __future__ import annotations

import json
from dataclasses import replace

import control
import numpy as np
import pytest
from click.testing import CliRunner
from scipy.io import loadmat
from scipy.signal import cont2discrete
from tests.shared import membranes
from tests.shared.fake_tables import whole
from tests.shared.tube_trees import specimen, tree

import deabayes
from deabayes.cli.main import cli
from deabayes.experiment import Excitation, Quantity, Specimen
from deabayes.export import export
from deabayes.export.source import evenly
from deabayes.faults import UserError
from deabayes.posteriors.storage import stacked, write_tree
from deabayes.systems import build
from deabayes.systems.tubular.circuit import Circuit
from deabayes.systems.tubular.sine import Harmonic
from deabayes.systems.tubular.voigt_kelvin import Chain, MovingChain

ENDINGS = ("1", "2", "2_inertia", "2_circuit", "2_inertia_circuit")
CANDIDATES = [f"voigt_kelvin_{ending}" for ending in ENDINGS]
STRIP = Specimen("strip", "tensile_strip", {}, {})
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


def opened(path):
    """The model as a Python user reads the file."""
    if path.suffix == ".json":
        return json.loads(path.read_text())
    return loadmat(path, simplify_cells=True)["model"]


JUMP = 1e-9
"""[s] in which the voltage changes from one held value to the next."""


@pytest.mark.parametrize("ending", ["json", "mat"])
@pytest.mark.parametrize("candidate", ["voigt_kelvin_2", "voigt_kelvin_2_inertia"])
def test_python_control_simulates_what_the_package_simulates(candidate, ending, tmp_path):
    """Continuous: a voltage that is switched on; discrete: voltages held for a sample each."""
    load = {"load_g": 300.0} if "inertia" in candidate else {}
    path = tmp_path / f"model.{ending}"
    certain = {n: replace(q, sd=None) for n, q in specimen().quantities.items()}
    posterior = tree(candidate, of=replace(specimen(), quantities=certain))
    export(posterior, "state-space", path, rate="1 kHz", **load)
    model = opened(path)
    assert list(model["axes"]) == ["draw", "row", "column"]
    step = model["discrete"]["sample_time"]["value"]
    time = step * np.arange(120)
    held = np.random.default_rng(0).uniform(0.0, 2500.0, time.size)
    jumps = np.column_stack([time, time + step - JUMP]).ravel()
    for which, dt, volts, drive in (
        ("continuous", 0.0, np.full(time.size, 2000.0), {"time": time, "voltage": 2000.0}),
        ("discrete", step, held, {"time": jumps, "voltage": np.repeat(held, 2)}),
    ):
        known = {name: quantity.value for name, quantity in certain.items()}
        strain = deabayes.simulate(
            "tubular", candidate, draws_of(model), known, conditions=load, **drive
        ).strain.values[:, :: len(drive["time"]) // time.size]
        plants = [control.ss(*abcd, dt) for abcd in zip(*matrices(model, which), strict=True)]
        found = [control.forced_response(plant, time, volts**2).outputs for plant in plants]
        assert len(found) == 12
        np.testing.assert_allclose(found, strain, rtol=0.0, atol=1e-6 * strain.max())


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
    wanted = Harmonic(moving, circuit, per_square, 2000.0).per_volt(FREQUENCY)
    np.testing.assert_allclose(transfer(model), wanted, rtol=1e-9)
    assert model["input"] | {"description": ""} == {
        "name": "voltage_deviation", "unit": "V", "description": ""}  # fmt: skip
    assert [state["unit"] for state in model["states"]] == ["1", "1/s", "1", "1", "V"]


def test_linearised_gain_without_mass(tmp_path):
    model = exported(tree("voigt_kelvin_2_circuit"), tmp_path, bias="2 kV")
    chain, _, circuit, per_square = parts(model)
    wanted = Harmonic(chain, circuit, per_square, 2000.0).per_volt(FREQUENCY)
    np.testing.assert_allclose(transfer(model), wanted, rtol=1e-9)


@pytest.mark.parametrize("candidate", CANDIDATES)
def test_the_operating_point_is_the_steady_state(candidate, tmp_path):
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
    options = {"rate": "10 kHz", "bias": "2 kV", "load_g": 300.0, "draws": 7}
    model = exported(posterior, tmp_path, **options)
    export(posterior, "state-space", tmp_path / "model.mat", **options)
    matlab = opened(tmp_path / "model.mat")
    for which in ("continuous", "discrete"):
        for got, stored in zip(matrices(model, which), matrices(matlab, which), strict=True):
            assert np.array_equal(got.squeeze(), stored)
    assert matlab["continuous"]["A"].shape == (7, 5, 5)
    assert matlab["discrete"]["sample_time"]["value"] == model["discrete"]["sample_time"]["value"]
    assert [s["name"] for s in matlab["states"]] == [s["name"] for s in model["states"]]
    assert np.array_equal(draws_of(model)["E_1"], matlab["draws"]["parameters"]["E_1"]["values"])
    assert matlab["provenance"] == "simulated" and matlab["converged"]


def test_the_file_states_candidate_provenance_and_convergence(tmp_path):
    model = exported(tree("voigt_kelvin_2", converged=False), tmp_path)
    assert model["candidate"] == "voigt_kelvin_2" and model["system"] == "tubular"
    assert "simulated" in model["provenance_note"] and model["deabayes_version"] == "0.1.0"
    assert model["converged"] is False and model["sensor_delay"]["value"] == 4e-4
    assert "discrete" not in model and model["operating_point"] == {}


@pytest.mark.parametrize("channel", ["delay", "displacement.delay", "strain.delay"])
def test_a_sensor_delay_of_the_instruments_is_exported(channel, tmp_path):
    late = {"current.delay": Quantity(7e-4, "s"), channel: Quantity(3e-4, "s")}
    posterior = tree("voigt_kelvin_2", of=replace(specimen(), instruments=late))
    assert exported(posterior, tmp_path)["sensor_delay"]["value"] == 3e-4


@pytest.mark.parametrize("sd", [None, 5e-5])
def test_a_sensor_delay_of_the_quantities_is_exported(sd, tmp_path):
    quantities = specimen().quantities | {"sensor_delay": Quantity(3e-4, "s", sd)}
    late = replace(specimen(), quantities=quantities, instruments={})
    model = exported(tree("voigt_kelvin_2", of=late), tmp_path)
    assert model["sensor_delay"]["value"] == 3e-4 and model["sensor_delay"].get("sd") == sd
    assert ("sensor_delay" in draws_of(model)) == (sd is not None)
    without = replace(specimen(), instruments={"current.delay": Quantity(7e-4, "s")})
    assert "sensor_delay" not in exported(tree("voigt_kelvin_2", of=without), tmp_path)


def test_draws_are_evenly_spaced_and_their_positions_are_stored(tmp_path):
    posterior = tree("voigt_kelvin_2", size=20)
    model = exported(posterior, tmp_path, draws=8)
    assert model["draws"]["ensemble"] == [0] * 4 + [1] * 4
    assert model["draws"]["draw"] == [2, 7, 12, 17] * 2
    rows = 20 * np.array(model["draws"]["ensemble"]) + np.array(model["draws"]["draw"])
    assert np.array_equal(draws_of(model)["tau_1"], stacked(posterior["posterior"], "tau_1")[rows])
    assert np.array_equal(evenly(40, 40), np.arange(40))
    assert len(exported(tree("voigt_kelvin_2", size=200), tmp_path)["draws"]["draw"]) == 200


@pytest.mark.parametrize(
    ("candidate", "name", "options", "words"),
    [
        (
            "voigt_kelvin_2",
            "m.csv",
            {},
            "writes .json or .mat files; end the name after -o",
        ),
        ("voigt_kelvin_2", "m", {}, "found 'no ending'"),
        ("voigt_kelvin_2", "m.json", {"rate": "10"}, "--rate: '10' has no unit"),
        ("voigt_kelvin_2", "m.json", {"rate": "10 ms"}, "--rate: unit 'ms' is a time"),
        ("voigt_kelvin_2", "m.json", {"rate": "0 Hz"}, "--rate must be above zero"),
        ("voigt_kelvin_2", "m.json", {"bias": "-2 kV"}, "--bias must be above zero"),
        ("voigt_kelvin_2", "m.json", {"draws": 13}, "--draws 13: the posterior holds 12 draws"),
        (
            "voigt_kelvin_2_inertia",
            "m.json",
            {"load_g": -1.0},
            "--load-g must be a mass in g of zero",
        ),
        ("voigt_kelvin_2", "m.json", {"load_g": 5.0}, "has no mass, so no load can hang from it"),
    ],
)
def test_impossible_options_are_refused(candidate, name, options, words, tmp_path):
    with pytest.raises(UserError) as caught:
        export(tree(candidate), "state-space", tmp_path / name, **options)
    assert words in str(caught.value) and list(tmp_path.iterdir()) == []


def test_draws_without_finite_matrices_are_refused(tmp_path):
    posterior = tree("voigt_kelvin_2_inertia")
    posterior["posterior"]["tau_1"].values[0, 2] = 0.0
    with pytest.raises(UserError, match="matrices of 1 of 12 draws are not finite"):
        exported(posterior, tmp_path)


@pytest.mark.parametrize(
    "other",
    [Specimen("strip", "tensile_strip", {}, {}), membranes.PLAIN],
    ids=lambda other: other.system,
)
def test_a_system_that_is_not_linear_has_no_state_space(other, tmp_path):
    words = f"kv_gm_1 of system .{other.system}. has no linear model, so it has no state"
    with pytest.raises(UserError, match=words):
        exported(tree("kv_gm_1", of=other), tmp_path)


@pytest.mark.parametrize(
    ("to", "option", "value", "takers"),
    [
        ("csv", "rate", "1 kHz", "state-space"),
        ("mat", "draws", 3, "state-space or abaqus or ansys"),
        ("abaqus", "load_g", 0.0, "state-space"),
        ("json", "bias", "2 kV", "state-space"),
    ],
)
def test_options_of_another_format_are_refused(to, option, value, takers, tmp_path):
    words = f"--to {to} takes no option --{option.replace('_', '-')}; only --to {takers} does"
    with pytest.raises(UserError, match=f"^{words}$"):
        export(tree("voigt_kelvin_1"), to, tmp_path / "x", **{option: value})
    assert not (tmp_path / "x").exists()


def test_the_command_passes_its_options_and_warns_of_a_low_rate(tmp_path):
    posterior = tree("voigt_kelvin_2_inertia_circuit")
    write_tree(whole(posterior), tmp_path / "posterior.nc")
    arguments = (
        f"export {tmp_path}/posterior.nc --to state-space -o {tmp_path}/command.json".split()
    )
    arguments += ["--rate", "2 Hz", "--draws", "4", "--load-g", "300", "--bias", "2 kV"]
    result = CliRunner().invoke(cli, arguments)
    assert result.exit_code == 0, result.output
    assert "command.json: --rate 2 Hz is too low for the resonance at" in result.stderr
    options = {"rate": "2 Hz", "draws": 4, "load_g": 300.0, "bias": "2 kV"}
    written = json.loads((tmp_path / "command.json").read_text())
    assert written == exported(posterior, tmp_path, **options)


def test_a_rate_below_twice_the_resonance_gives_a_warning(tmp_path):
    posterior = tree("voigt_kelvin_2_inertia")
    model = exported(posterior, tmp_path, draws=5)
    poles = np.linalg.eigvals(np.array(model["continuous"]["A"]))
    resonance = float(np.median(np.abs(poles.imag).max(axis=1) / (2 * np.pi)))
    warnings = {
        times: export(
            posterior, "state-space", tmp_path / "m.json", rate=times * resonance, draws=5
        )
        for times in (1.9, 2.1)
    }
    assert warnings[2.1] == []
    assert f"the resonance at {resonance:.3g} Hz" in warnings[1.9][0]
    without_mass = tree("voigt_kelvin_2")
    assert export(without_mass, "state-space", tmp_path / "m.json", rate="1 mHz") == []
