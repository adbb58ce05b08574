"""A gain brings its record's phase: whether that is counted twice, named twice, sound."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.shared.study_folders import faults_of

from deabayes.checks.study import check_study
from deabayes.experiment import FloatArray
from deabayes.faults import Faults
from deabayes.pipeline import prepare_study
from deabayes.records.folder import read_folder
from deabayes.study import Study

SPECIMEN = """\
name: tube
system: tubular
provenance: {kind: measured, source: here, licence: none}
quantities:
  thickness: {value: 80, unit: um, sd: 2}
  relative_permittivity: {value: 3.1, unit: '1', sd: 0.1}
  active_length: {value: 70, unit: mm}
  cross_section: {value: 600, unit: mm^2}
  total_mass: {value: 100.5, unit: g}
  active_mass: {value: 46.2, unit: g}
  sensor_mass: {value: 10, unit: g}
"""
TABLE = """\
name,protocol,record,role,excitation,response,bias_kV
f1,frequency_response,f1.csv,calibrate,frequency,gain,2
"""
FREQUENCY = np.linspace(1.0, 50.0, 60)
RATIO = 1e-5 / (1.0 - (FREQUENCY / 30.0) ** 2 + 0.1j * FREQUENCY / 30.0)
PHASE = np.angle(RATIO)
DAMPED = -np.angle(1.0 - (FREQUENCY / 30.0) ** 2 + 1j * FREQUENCY / 30.0)


def folder(
    path: Path, *rows: str, phase: FloatArray = PHASE, more: str = "", faster: float = 1.0
) -> Path:
    """A study folder with one record of gain and phase, named by further rows."""
    table = np.column_stack([faster * FREQUENCY, np.abs(RATIO), phase])
    np.savetxt(path / "f1.csv", table, delimiter=",", comments="",
               header="frequency [Hz],gain [1/V],phase [rad]")  # fmt: skip
    (path / "specimen.yaml").write_text(SPECIMEN + more, encoding="utf-8")
    (path / "experiments.csv").write_text(TABLE + "".join(f"{r}\n" for r in rows), encoding="utf-8")
    return path


def row(name: str, role: str, response: str) -> str:
    return f"{name},frequency_response,f1.csv,{role},frequency,{response},2"


@pytest.mark.parametrize(
    ("added", "said"),
    [
        (row("f1p", "validate", "phase"),
         "validate record 'f1p' is the phase that calibrate record 'f1' brings with its gain, as "
         "'f1_phase'; remove the row 'f1p'"),
        (row("f1p", "calibrate", "phase"), "calibrate record 'f1p' is the phase that calibrate"),
        (row("F1_phase", "calibrate", "phase"), "remove the row 'F1_phase'"),
        (row("f1_phase", "calibrate", "phase"),
         "row 'f1_phase' has the name of the phase that row 'f1' brings with its gain; rename it"),
        (row("f2", "calibrate", "gain"),
         "calibrate record 'f2' holds the same values as calibrate record 'f1'"),
        (row("f2", "validate", "gain"),
         "validate record 'f2' holds the same values as calibrate record 'f1'"),
    ],
)  # fmt: skip
def test_what_a_gain_brings_is_not_given_again(tmp_path: Path, added: str, said: str) -> None:
    faults = faults_of(folder(tmp_path, added))
    assert len([fault for fault in faults if said in fault]) == 1
    assert len(faults) == 1 + ("F1_phase" in added)


def test_what_is_only_held_out_may_be_the_same(tmp_path: Path) -> None:
    """Unless a study fits one of the two."""
    path = folder(tmp_path, row("f1p", "validate", "phase"))
    table = (path / "experiments.csv").read_text()
    (path / "experiments.csv").write_text(table.replace("calibrate", "validate"))
    assert faults_of(path) == []
    study = Study("s", path, ("voigt_kelvin_1_inertia",), calibrate=("f1p",), validate=("f1",))
    (fault,) = check_study(study).faults
    assert "study s: calibrate record 'f1p' is the phase that validate record 'f1' brings" in fault


def test_a_phase_without_a_value_is_a_fault_of_the_folder(tmp_path: Path) -> None:
    lost = np.where(FREQUENCY < 3.0, np.nan, PHASE)
    (fault,) = faults_of(folder(tmp_path, phase=lost))
    assert "f1.csv (f1), column phase: values missing, NaN or infinite: 3" in fault


def test_rows_without_a_phase_are_left_out_where_asked_for(tmp_path: Path) -> None:
    lost = np.where(FREQUENCY < 3.0, np.nan, PHASE)
    drop = "record_format: {incomplete_rows: drop}\n"
    path = folder(tmp_path, phase=lost, more=drop)
    read = read_folder(path)
    assert read.record(read.table[0]).left_out == 3
    gain, phase = prepare_study(Study("s", path, ("voigt_kelvin_1_inertia",)), tmp_path / "out")
    assert gain.response.size == phase.response.size == 57


def test_unsorted_frequencies_are_no_loading(tmp_path: Path) -> None:
    path = folder(tmp_path)
    lines = (path / "f1.csv").read_text().splitlines()
    (path / "f1.csv").write_text("\n".join([lines[0], *lines[31:], *lines[1:31]]) + "\n")
    gain, _ = prepare_study(Study("s", path, ("voigt_kelvin_1_inertia",)), tmp_path / "out")
    (warning,) = gain.warnings
    assert warning == "frequency goes back and forth; samples were put in ascending order"


def test_a_phase_of_the_wrong_sign_rises(tmp_path: Path) -> None:
    """Its prior expects it to fall, and says which sign a lag has."""
    path = folder(tmp_path, phase=-PHASE)
    study = Study("s", path, ("voigt_kelvin_1_inertia",))
    warnings = check_study(study, compare=True).warnings
    (found,) = [line for line in warnings if "f1_phase" in line]
    assert found.endswith(
        "f1_phase: phase rises where the prior expects it to fall; is its sign right (lag is "
        "negative)?"
    )


@pytest.mark.parametrize(
    ("phase", "said"),
    [
        (DAMPED, "to rise: the candidate has no mass, so nothing in it resonates; take one with "
         "_inertia for this record, under candidates or by predict_with"),
        (1.0 / FREQUENCY, "to rise; is its sign right (lag is negative)?"),
    ],
)  # fmt: skip
def test_a_candidate_without_mass_says_nothing_of_a_resonance(
    tmp_path: Path, phase: FloatArray, said: str
) -> None:
    """Only its lag fades with frequency; one of the wrong sign fades from above."""
    study = Study("s", folder(tmp_path, phase=phase, faster=20.0), ("voigt_kelvin_1",))
    warnings = check_study(study, compare=True).warnings
    (found,) = [line for line in warnings if "f1_phase" in line]
    assert found.endswith(f"f1_phase: phase falls where the prior expects it {said}")


def test_a_bias_beyond_what_the_amplifier_can(tmp_path: Path) -> None:
    path = folder(tmp_path, more="instruments: {voltage: {range: {value: 5, unit: kV}}}\n")
    table = (path / "experiments.csv").read_text()
    (path / "experiments.csv").write_text(table.replace("gain,2\n", "gain,2000\n"))
    with pytest.raises(Faults) as error:
        read_folder(path)
    (fault,) = error.value.faults
    assert "bias_kV is 2000 in experiments.csv, beyond the voltage's range of 5 kV" in fault
