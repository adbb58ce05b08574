"""Prepared files, and the real records where they are at hand."""

from __future__ import annotations

import os
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from tests.shared.strip_records import LAGGING, prepared, relaxation

from deabayes.experiment import Experiment
from deabayes.faults import UserError
from deabayes.figures import preparation, style
from deabayes.records.columns import RawRecord
from deabayes.records.folder import read_folder
from deabayes.records.preparation import prepare
from deabayes.records.preparation.prepared import read_overview, read_prepared, write_prepared

REPOSITORY = Path(__file__).parents[2]
DATA = Path(os.environ.get("DEABAYES_DATA", REPOSITORY.parent / "shared" / "data"))
STEPS = (
    {"mask_before": {"time": "0.5 s"}},
    {"mask_ramp_end": {}},
    {"excitation_knots": {}},
    {"average": {}},
)
VHB = {
    "relaxation": [
        {"mask_before": {"time": "0.12 s"}},
        {"mask_ramp_end": {"before": "0.06 s", "after": "0.4 s"}},
        {"excitation_knots": {"tolerance": "0.07 mm"}},
        {"average": {"grid": "geometric", "first_width": "0.1 s", "widest": "20 s"}},
    ],
    "load_unload": [
        {"mask_before": {"time": "0.2 s"}},
        {"mask_ramp_end": {"before": "0.06 s", "after": "0.25 s"}},
        {"mask_slack": {"threshold": "0.01 N"}},
        {"excitation_knots": {"tolerance": "0.07 mm"}},
        {"average": {"grid": "uniform", "points": 180}},
    ],
}
SETS = {"vhb4910": (18, "vhb4910_zhao"), "treloar": (3, "treloar_kawabata"),
        "silicones": (8, "soft_silicones_srmd")}  # fmt: skip


def same(first: object, second: object) -> bool:
    """Equal, arrays bit for bit, dataclasses field by field."""
    if isinstance(first, np.ndarray):
        return first.dtype == second.dtype and np.array_equal(first, second)  # type: ignore[attr-defined]
    if hasattr(first, "__dataclass_fields__"):
        return all(same(getattr(first, f.name), getattr(second, f.name)) for f in fields(first))  # type: ignore[arg-type]
    return first == second


def written(tmp_path: Path) -> tuple[Experiment, RawRecord, Path]:
    record = relaxation()
    experiment = prepared(record, *STEPS)
    path = tmp_path / "prepared" / "a.nc"
    write_prepared(experiment, path, record)
    return experiment, record, path


def test_round_trip_is_exact(tmp_path: Path) -> None:
    experiment, _, path = written(tmp_path)
    assert same(read_prepared(path), experiment)
    assert [p.name for p in path.parent.iterdir()] == ["a.nc"]


def test_file_carries_units_and_the_hash(tmp_path: Path) -> None:
    import xarray as xr

    _, record, path = written(tmp_path)
    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        units = {name: variable.attrs["units"] for name, variable in dataset.variables.items()}
        assert units["response"] == units["raw_response"] == "N"
        assert units["excitation"] == "m"
        assert units["coordinate"] == "s"
        assert dataset.attrs["record_sha256"] == record.sha256


def test_raw_copy_shows_what_was_hidden(tmp_path: Path) -> None:
    _, record, path = written(tmp_path)
    overview = read_overview(path)
    assert overview is not None
    assert overview.coordinate.size <= 2000
    distance = np.abs(overview.coordinate - 3.1)  # the ramp ends at 3 s: -0.1 to +0.3 s
    hidden = (overview.coordinate < 0.5) | (distance <= 0.2)
    clear = np.abs(distance - 0.2) > 0.03
    assert np.array_equal(overview.masked[clear], hidden[clear])
    assert overview.response.max() == record.columns["force"].max()


def test_masks_after_a_delay_are_kept_on_the_files_own_time(tmp_path: Path) -> None:
    steps = ({"delay": {}}, {"mask_after": {"time": "10 s"}})
    record = relaxation(end=20.0)
    write_prepared(prepared(record, *steps, specimen=LAGGING), tmp_path / "a.nc", record)
    overview = read_overview(tmp_path / "a.nc")
    assert overview is not None
    late = overview.coordinate > 10.5 + 1e-9
    assert overview.masked[late].all()
    assert not overview.masked[(overview.coordinate > 0.51) & ~late].any()


def test_failed_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:

    def half(path: Path, _: object) -> None:
        path.write_text("half")
        raise OSError("disk full")

    monkeypatch.setattr(Path, "write_bytes", half)
    with pytest.raises(OSError, match="disk full"):
        written(tmp_path)
    assert not list((tmp_path / "prepared").iterdir())


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such prepared record"):
        read_prepared(tmp_path / "none.nc")
    (tmp_path / "text.nc").write_text("no netCDF")
    with pytest.raises(UserError, match="not a readable netCDF"):
        read_prepared(tmp_path / "text.nc")


def test_figure_names_units_and_shows_all_layers(tmp_path: Path) -> None:
    _, _, path = written(tmp_path)
    with style.applied():
        (sheet,) = preparation.draw(path)
        sheet.savefig(tmp_path / "a.png")
    above, below = (ax for sub in sheet.subfigs for ax in sub.axes)
    assert above.get_ylabel() == "force (mN)"  # the points stay below 1 N
    assert below.get_ylabel() == "displacement\n(mm)"
    assert "(s)" in below.get_xlabel()
    assert len(above.lines) == 3


@pytest.mark.parametrize("name", SETS)
def test_every_real_record_prepares(name: str, tmp_path: Path) -> None:
    count, folder = SETS[name]
    if not (DATA / folder).is_dir():
        pytest.skip(f"{DATA / folder} is missing; set DEABAYES_DATA to a copy of the public data")
    study = read_folder(REPOSITORY / "data" / name, DATA)
    assert len(study.table) == count
    for row in study.table:
        raw = study.record(row)
        assert not study.warnings(row)  # among them: the file is the registered one
        experiment = prepare(row, raw, study.specimen, VHB.get(row.protocol))
        if row.protocol in VHB:
            assert 140 < experiment.coordinate.size < 200
            assert experiment.excitation.coordinate.size <= 10
            stretch = 1.0 + raw.columns["displacement"] / 0.08
            error = experiment.excitation.at(raw.columns["time"]) - raw.columns["displacement"]
            assert np.max(np.abs(error) / 0.08 / stretch) < 1e-3
            assert stretch.max() == pytest.approx(float(row.metadata["stretch"]), abs=0.02)
        if row.protocol == "relaxation":
            # The machine's transients are hidden: forces rise in loading and fall in holding.
            peak = int(np.argmax(experiment.response))
            assert np.diff(experiment.response[: peak + 1]).min() > -0.01
            assert np.diff(experiment.response[peak:]).max() < 0.004
        write_prepared(experiment, tmp_path / f"{row.name}.nc", raw)
        assert same(read_prepared(tmp_path / f"{row.name}.nc"), experiment)
