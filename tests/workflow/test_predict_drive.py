"""`deabayes predict POSTERIOR --excitation FILE`: a protocol of one's own, as a table or netCDF."""

from __future__ import annotations

import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tests.posteriors.test_predict_with import STUDY, creep, file

from deabayes.api import open_posterior
from deabayes.cli.drive import read_drive
from deabayes.cli.main import main
from deabayes.posteriors.storage import sum_of_draws, write_tree
from deabayes.records.preparation.prepared import write_prepared
from deabayes.study import Study

DRIVE = "time [ms],voltage [kV]\n0,0\n10,1.8\n500,1.8\n"


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_tree(file(None), tmp_path / "posterior.nc")
    (tmp_path / "drive.csv").write_text(DRIVE)
    return tmp_path


def predict(*more: str) -> None:
    main(["predict", "posterior.nc", "--excitation", "drive.csv", *more])


def test_a_table_with_units_holds_what_python_gives(place: Path) -> None:
    predict("-o", "out/prediction.csv")
    table = pd.read_csv("out/prediction.csv")
    expected = open_posterior("posterior.nc").predict(
        time=[0.0, 0.01, 0.5], voltage=[0.0, 1800.0, 1800.0]
    )
    assert list(table)[:4] == ["time [s]", "voltage [V]", "strain_median [1]", "strain_mean [1]"]
    np.testing.assert_allclose(table["voltage [V]"], [0.0, 1800.0, 1800.0])
    np.testing.assert_allclose(table["strain_median [1]"], expected["median"])
    for band in ("parameter", "discrepancy", "predictive"):
        for level in (0.5, 0.9):
            for bound in ("lower", "upper"):
                np.testing.assert_allclose(
                    table[f"{band}_{100 * level:.0f}_{bound} [1]"],
                    expected[band].sel(level=level, bound=bound),
                )
    predict("-o", "out/prediction.nc")
    xr.testing.assert_allclose(xr.load_dataset("out/prediction.nc", engine="h5netcdf"), expected)


def test_what_is_to_be_known_of_it_is_said(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (place / "drive.csv").write_text(DRIVE.replace("1.8", "8"))
    predict("-o", "out.csv", "--response", "displacement")
    lines = capsys.readouterr().err.splitlines()
    (said,) = (line for line in lines if "extrapolation" in line)
    assert said.startswith("out.csv: extrapolation: voltage 0 to 8000 V lies outside")
    assert "PredictionWarning" not in " ".join(lines)
    assert "displacement_median [m]" in Path("out.csv").read_text()


def test_volts_where_kilovolts_were_calibrated_are_a_line_on_the_terminal(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (place / "drive.csv").write_text(DRIVE.replace("kV", "V"))
    predict("-o", "out.csv")
    (said,) = (line for line in capsys.readouterr().err.splitlines() if "kV" in line)
    assert said.startswith("out.csv: voltage reaches only 1.8 V, and the calibration records ")


ERRORS = pd.DataFrame(
    {
        "experiment": ["creep_1kV", "creep_2kV", "sine_2kV", "sine_1kV"],
        "role": ["calibrate", "validate", "validate", "validate"],
        "coverage_90": [0.3, 0.95, 0.62, 0.531],
    }
)


@pytest.mark.parametrize("provenance", ["simulated", "measured"])
@pytest.mark.parametrize("converged", [True, False])
@pytest.mark.parametrize("extrapolated", [True, False])
def test_a_table_says_what_it_is_worth(
    place: Path, provenance: str, converged: bool, extrapolated: bool
) -> None:
    """As the terminal does, which is not kept; it is a record still, and numbers alone."""
    tree = file(None)
    tree.attrs["convergence"] = json.dumps({"converged": converged})
    specimen = json.loads(tree.attrs["specimen"])
    tree.attrs["specimen"] = json.dumps(specimen | {"provenance": {"kind": provenance}})
    write_tree(tree, place / "posterior.nc")
    drive = "time [s],voltage [kV]\n0,2\n0.5,2\n"
    (place / "drive.csv").write_text(drive.replace("2\n", "8\n") if extrapolated else drive)
    predict("-o", "out.csv")
    table = pd.read_csv("out.csv")
    told = {"simulated": provenance == "simulated", "converged": converged}
    told["extrapolated"] = extrapolated
    assert list(table)[-3:] == list(told)
    assert (table[list(told)] == [int(each) for each in told.values()]).all(axis=None)
    assert np.loadtxt("out.csv", delimiter=",", skiprows=1).shape == table.shape
    assert read_drive("tubular", place / "out.csv").keys() == {"time", "voltage"}


NARROW = (
    "the 90 % bands of 2 of 3 held-out records are too narrow: they hold 53 % of sine_1kV, 62 % of "
    "sine_2kV. Bands of other excitations may be too narrow as well"
)


def note() -> str:
    """What netCDF and terminal say of held-out records, the same."""
    predict("-o", "out.nc")
    return str(xr.load_dataset("out.nc", engine="h5netcdf").attrs["held_out_note"])


def written(study: Study, seed: int = 1) -> str:
    """Write a posterior file; what tells its draws."""
    tree = file(None, study)
    tree["posterior"]["E_0"] += 1e-9 * seed
    write_tree(tree, Path("posterior.nc"))
    return sum_of_draws(tree)


def test_bands_that_missed_what_was_held_out_are_said(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whenever the file was written: a copy is newer than the scores beside it."""
    draws = sum_of_draws(open_posterior("posterior.nc").data)
    ERRORS.assign(posterior_draws=draws).to_csv("errors.csv", index=False)
    for age in (60.0, -60.0):
        changed = (place / "posterior.nc").stat().st_mtime + age
        os.utime(place / "errors.csv", (changed, changed))
        assert note() == NARROW
        assert f"out.nc: {NARROW}\n" in capsys.readouterr().err
    ERRORS.assign(coverage_90=0.9, posterior_draws=draws).to_csv("errors.csv", index=False)
    assert note() == ""


def test_scores_that_are_copied_along_are_those_of_the_copy(place: Path) -> None:
    """As `deabayes predict` writes them, of a record far from what was fitted."""
    held_out = replace(creep(), name="other", role="validate", response=1e6 * creep().response)
    for record in (creep(), held_out):
        write_prepared(record, Path("prepared") / f"{record.name}.nc")
    main(["predict", "posterior.nc", "--prepared", "prepared", "-o", "all"])
    copy = place / "copy"
    copy.mkdir()
    Path("errors.csv").rename(copy / "errors.csv")
    shutil.copyfile("posterior.nc", copy / "posterior.nc")
    copied = open_posterior(copy / "posterior.nc").predict(time=[0.0, 1.0], voltage=1800.0)
    assert copied.attrs["held_out_note"].startswith("the 90 % bands of 1 of 1 held-out records")


@pytest.mark.parametrize("validate", [None, ("sine_1kV",), ()])
def test_scores_that_are_not_at_hand_are_missed(
    place: Path, validate: tuple[str, ...] | None
) -> None:
    """Unless the study names none to hold out."""
    study = replace(STUDY, validate=validate)
    before = written(study)
    said = {"absent": note()}
    for name, table in (
        ("of other draws", ERRORS.assign(posterior_draws=before)),
        ("of before", ERRORS),
    ):
        written(study, seed=2)
        table.to_csv("errors.csv", index=False)
        said[name] = note()
    Path("errors.csv").write_text("")
    said["empty"] = note()
    if validate == ():
        assert set(said.values()) == {""}
        return
    assert re.match(r"held-out scores \(errors\.csv\) are not beside .*copy", said.pop("absent"))
    for name, text in said.items():
        assert re.match(r"errors\.csv beside .* not of its draws.*deabayes predict", text), name


def test_a_frequency_response_under_a_load(place: Path) -> None:
    (place / "drive.csv").write_text("frequency [Hz]\n10\n20\n40\n")
    held = ("--condition", "bias_kV=2", "--condition", "load_g=300")
    predict("-o", "out.csv", "--response", "gain", *held)
    assert list(pd.read_csv("out.csv"))[:2] == ["frequency [Hz]", "gain_median [1/V]"]


@pytest.mark.parametrize("fitted", ["strain", "gain"])
def test_a_frequency_response_is_named_unless_one_was_fitted(
    place: Path, capsys: pytest.CaptureFixture[str], fitted: str
) -> None:
    (place / "drive.csv").write_text("frequency [Hz]\n10\n20\n40\n")
    if fitted == "gain":
        tree = file(None)
        records = json.loads(tree.attrs["experiments"])
        records[0] |= {"excitation_name": "frequency", "response_name": "gain"}
        tree.attrs["experiments"] = json.dumps(records)
        write_tree(tree, place / "posterior.nc")
        predict("-o", "out.csv", "--condition", "bias_kV=2")
        assert "gain_median [1/V]" in pd.read_csv("out.csv")
        return
    with pytest.raises(SystemExit):
        predict("-o", "out.csv", "--condition", "bias_kV=2")
    said = capsys.readouterr().err
    assert "no response is named; give --response gain or phase" in said
    assert "strain" not in said and said.count("\n") == 1


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ((), "-o"),
        (("-o", "out.xlsx"), r"-o out\.xlsx: .*\.csv or \.nc"),
        (("-o", "drive.csv"), "this file is an input; name another file"),
        (("-o", "out.csv", "--condition", "load_g"), "--condition 'load_g': expected NAME=VALUE"),
        (("-o", "out.csv", "--condition", "laod_g=3"), "laod_g.*did you mean 'load_g'"),
        (("-o", "out.csv", "--excitation", "."), r"deabayes: \.: is a folder; name the file"),
        (("-o", "out.csv", "--errors", "e.csv"), "--errors .* --excitation"),
    ],
)
def test_mistakes(
    place: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...], words: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        predict(*more)
    said = capsys.readouterr().err
    assert ended.value.code == 1
    assert re.search(words, said), said
    assert said.count("\n") == 1


def test_a_response_alone_goes_with_an_excitation(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["predict", "posterior.nc", "--response", "strain"])
    assert "--response needs --excitation" in capsys.readouterr().err


def test_a_study_by_name_has_one_posterior_or_names_them(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where a folder is called as the study."""
    (place / "tube").mkdir()
    wanted = Path("results/tube/one/posterior.nc")
    wanted.parent.mkdir(parents=True)
    wanted.write_bytes(Path("posterior.nc").read_bytes())
    by_name = ("predict", "tube", "--excitation", "drive.csv", "-o")
    main([*by_name, "named.csv"])
    predict("-o", "file.csv")
    main(["predict", "tube/one", *by_name[2:], "candidate.csv"])
    for name in ("named.csv", "candidate.csv"):
        assert Path(name).read_text() == Path("file.csv").read_text()
    other = Path("results/tube/two/posterior.nc")
    other.parent.mkdir()
    other.write_bytes(wanted.read_bytes())
    capsys.readouterr()
    for arguments, said in (
        ([*by_name, "again.csv"], "study tube has 2 fitted candidates; give tube/one or tube/two"),
        (["predict", "tub", *by_name[2:], "again.csv"], "'tub' is neither a posterior file nor"),
        (["predict", "tube/ane", *by_name[2:], "again.csv"], "did you mean 'tube/one'"),
    ):
        with pytest.raises(SystemExit):
            main(arguments)
        assert said in capsys.readouterr().err
