"""The reference membrane: what ships is what the script writes, and another solver agrees."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from data.make import membrane as reference
from tests.shared.golden import REPOSITORY, golden_table
from tests.shared.membranes import membrane, voltage
from tests.shared.shipped import check_regenerated, table

SHIPPED = REPOSITORY / "data" / "membrane"


@pytest.fixture(scope="module")
def regenerated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("membrane")
    reference.write(folder)
    return folder


def test_the_shipped_specimen_is_what_the_script_writes(regenerated):
    check_regenerated(regenerated, SHIPPED, lambda record: [1e-9, 1.1e-4, 2e-4, 0.11])


def test_without_the_slow_unit_and_the_amplifier_it_is_the_golden_step():
    step = golden_table("membrane_step", "n3_4kV")
    simple = reference.Truth(
        mu_beta=(15e3,) * 3, tau_beta=(4.0, 33.5, 83.5), current_limit=float("inf")
    )
    _, stretch = reference.response(simple, lambda _: 4e3, 600.0)
    late = step["time"] > 10.0
    # The charging lag of 1 ms is left.
    np.testing.assert_allclose(stretch(step["time"])[late], step["stretch"][late], atol=2e-5)


def test_the_amplifier_keeps_to_its_current():
    volts, stretch = reference.response(reference.TRUTH, lambda _: 4e3, 10.0)
    time = np.linspace(0.0, 1.0, 2001)
    truth = reference.TRUTH
    capacitance = truth.permittivity * (truth.side_length * stretch(time) ** 2) ** 2
    current = np.gradient(volts(time) * capacitance / truth.thickness, time)
    assert np.max(current[5:-5]) == pytest.approx(truth.current_limit, rel=1e-3)
    assert time[np.argmax(volts(time) > 3999.0)] == pytest.approx(0.27, abs=0.02)
    assert volts(np.array([-1.0]))[0] == 0.0


def test_the_candidate_with_all_units_reproduces_a_record():
    truth = yaml.safe_load((SHIPPED / "truth.yaml").read_text())["parameters"]
    draws = {name: np.array([value]) for name, value in truth.items()}
    for name, residual in (("step_3kV", 1e-5), ("sine_0p05Hz", 1.5e-5)):
        time, kilovolt, millimetre, _ = table(SHIPPED / "records" / f"{name}.csv").T
        driven = voltage(time, 1e3 * kilovolt)
        found = membrane("kv_gm_4").predict(driven, time - 2e-3, "displacement", draws)[0]
        offset = np.mean(millimetre[:40]) * 1e-3
        difference = 1e-3 * millimetre - offset - found
        assert np.std(difference[time > 8.0]) < 0.5 * residual
        assert np.max(np.abs(difference[time > 8.0])) < 2.0 * residual


def test_the_slow_unit_is_beyond_three_units():
    slow, three = (
        reference.Truth(mu_beta=reference.TRUTH.mu_beta[:n], tau_beta=reference.TRUTH.tau_beta[:n])
        for n in (4, 3)
    )
    time = np.array([100.0])
    apart = [reference.response(truth, lambda _: 4e3, 100.0)[1](time)[0] for truth in (slow, three)]
    assert apart[1] - apart[0] > 20 * reference.SENSOR.sigma_ou / 0.01


def test_truth_and_provenance():
    specimen = yaml.safe_load((SHIPPED / "specimen.yaml").read_text())
    assert specimen["provenance"]["kind"] == "simulated"
    assert "slow Maxwell unit" in specimen["provenance"]["source"]
    truth = yaml.safe_load((SHIPPED / "truth.yaml").read_text())
    assert truth["parameters"]["tau_beta_4"] == 600.0
    assert truth["parameters"]["permittivity"] == 4.11e-11


@pytest.fixture(scope="module")
def prepared():
    """The records as the study `membrane` prepares them."""
    from deabayes.records.folder import read_folder
    from deabayes.records.preparation import prepare
    from deabayes.studies import load_study

    study = load_study(REPOSITORY / "config.yaml", "membrane")
    folder = read_folder(study.specimen)
    return {
        row.name: prepare(row, folder.record(row), folder.specimen, study.preparation[row.protocol])
        for row in folder.table
    }


def test_rows_that_share_a_record_read_their_own_columns(prepared):
    for kilovolt in (2, 3, 4):
        step, area = prepared[f"step_{kilovolt}kV"], prepared[f"area_{kilovolt}kV"]
        assert step.record_sha256 == area.record_sha256
        assert (step.response_unit, area.response_unit) == ("m", "m^2")
        assert (step.role, area.role) == ("calibrate" if kilovolt == 4 else "validate", "validate")
        # The displacement counts from rest, the area does not; the camera has no delay.
        assert 0.0 < step.response[0] < 1e-3 and area.response[0] > 900e-6
        side = 0.03 + np.interp(area.coordinate[20:], step.coordinate, step.response)
        np.testing.assert_allclose(area.response[20:], side**2, atol=4e-6)
        assert area.coordinate[-1] > step.coordinate[-1]


def test_the_studys_records_are_short_and_reach_their_ends(prepared):
    for name, each in prepared.items():
        assert 90 <= each.coordinate.size <= 200
        assert each.excitation.coordinate[-1] - each.coordinate[-1] < 4.5, name
        if each.protocol == "step":
            assert each.coordinate[0] - 5.0 > 0.39  # 0.5 s, to within a sample
            assert np.all(np.diff(each.coordinate)[:3] < 0.4)


def test_averaging_does_not_flatten_the_sine(prepared):
    """The candidate with all units, at the truth, sees the recorded amplitude to 0.4 %."""
    truth = yaml.safe_load((SHIPPED / "truth.yaml").read_text())["parameters"]
    draws = {name: np.array([value]) for name, value in truth.items()}
    for frequency in ("0p01", "0p02", "0p05"):
        each = prepared[f"sine_{frequency}Hz"]
        found = membrane("kv_gm_4").predict(
            each.excitation, each.coordinate, "displacement", draws
        )[0]
        late = each.coordinate > 50.0
        slope = np.polyfit(found[late], each.response[late], 1)[0]
        assert slope == pytest.approx(1.0, abs=0.004)
