"""One report collects faults and warnings, and a folder's records are checked once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.shared.study_folders import make_folder

from deabayes.checks.folder import check_folder
from deabayes.checks.study import check_study
from deabayes.experiment import Specimen
from deabayes.faults import Faults, Report, UserError
from deabayes.records import checks
from deabayes.records.columns import ExperimentRow, RawRecord
from deabayes.study import Study


def test_messages_begin_with_their_place() -> None:
    report = Report()
    column = report.at("a.csv (a)").at("column force")
    column.fault("is constant")
    column.warn("jumps", "data row 3")
    column.include(["data row 1: is no number"])
    report.fault("no place")
    assert report.faults == [
        "a.csv (a), column force: is constant",
        "a.csv (a), column force, data row 1: is no number",
        "no place",
    ]
    assert report.warnings == ["a.csv (a), column force, data row 3: jumps"]


def test_a_message_is_told_once() -> None:
    report = Report()
    for _ in range(2):
        report.at("a").fault("wrong")
        report.at("a").warn("odd")
    assert (report.faults, report.warnings) == (["a: wrong"], ["a: odd"])


def test_raised_faults_are_collected_and_raised_together() -> None:
    report = Report("study s")
    with report.catching():
        raise Faults(["first", "second"])
    with report.catching():
        raise UserError("third")
    with pytest.raises(Faults) as error:
        report.raise_faults()
    assert error.value.faults == ("study s, first", "study s, second", "study s, third")


def test_a_folder_and_its_study_check_every_record_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checked: list[str] = []
    check_record = checks.check_record

    def counted(row: ExperimentRow, raw: RawRecord, specimen: Specimen, place: str) -> Report:
        checked.append(row.name)
        return check_record(row, raw, specimen, place)

    monkeypatch.setattr(checks, "check_record", counted)
    folder = make_folder(tmp_path)
    report = check_folder(folder, as_study=False)
    study = check_study(Study("s", folder, ("kv_gm_1",)), read=report.read)
    assert report.faults == study.faults == []
    assert checked == ["relax", "pull"]


def test_every_fault_of_a_record_is_told_at_once() -> None:
    time = np.array([0.0, 1.0, 1.0, 0.5, 2.0])
    columns = {"time": time, "stretch": np.full(5, -1.0), "force": np.arange(5.0)}
    raw = RawRecord(columns, {"time": "s", "stretch": "1", "force": "N"}, "ab" * 32)
    row = ExperimentRow("a", "sweep", "a.csv", "calibrate", "stretch", "force", {})
    faults = checks.check_record(row, raw, Specimen("x", "", {}, {}), "a.csv (a)").faults
    starts = ["goes back", "data row 3 repeats", "is constant", "is -1 in data row 1"]
    assert len(faults) == len(starts)
    for fault, channel, start in zip(faults, ["time"] * 2 + ["stretch"] * 2, starts, strict=True):
        assert fault.startswith(f"a.csv (a), column {channel}: {start}")
