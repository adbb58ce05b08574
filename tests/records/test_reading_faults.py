"""A study folder broken in one place at a time: data.md, Bad input."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.shared.breaks import (
    Break,
    column,
    copy_record,
    cut_record,
    header,
    row,
    specimen,
    stated,
    table,
    voltage,
    whole,
)
from tests.shared.study_folders import TABLE, make_folder, record_lines, replace_in, write_lines

from deabayes.faults import Faults, UserError
from deabayes.records.folder import read_folder

RELAX = "relax.csv"
NO_NUMBERS = {
    ("load_g", '"3,0"'): "found '3,0'; write 3.0, with a decimal point, or leave the cell empty",
    ("voltage_kV", '"0,1"'): "found '0,1'; write 0.1, with a decimal point",
    ("voltage_kV", "three"): "found 'three'; give one in kV, without its unit",
    ("amplitude_kV", "200 V"): "found '200 V'; give one in kV, without its unit",
    ("frequency_Hz", "nan"): "found 'nan'; give one in Hz",
}
BREAKS: dict[str, tuple[Break, list[str]]] = {
    "missing record": (
        lambda folder: (folder / "records" / RELAX).unlink(),
        [RELAX, "no such file", "experiments.csv"],
    ),
    "misspelt record": (
        table("relax.csv", "relx.csv"),
        ["relx.csv", "did you mean 'records/relax.csv'?"],
    ),
    "folder for a record": (
        table("records/relax.csv", "records"),
        ["records (relax): is a folder, not a record", "experiments.csv"],
    ),
    "record on Windows": (
        table("records/relax.csv", "records\\relax.csv"),
        ["no such file", "did you mean 'records/relax.csv'?"],
    ),
    **{
        f"{column} {cell}": (stated(column, cell), [f"line 3, {column}: expected a number, {said}"])
        for (column, cell), said in NO_NUMBERS.items()
    },
    "noise in a larger unit": (
        specimen("{value: 1, unit: mN}", "{value: 1, unit: MN}"),
        [RELAX, "column force: varies by 1.167", "noise of 1e+06 N", "specimen.yaml"],
    ),
    "wrong ending": (table("relax.csv", "relax.txt"), ["did you mean 'records/relax.csv'?"]),
    "empty record": (lambda f: (f / "records" / RELAX).write_text(""), [RELAX, "is empty"]),
    "truncated record": (cut_record, [RELAX, "truncated", "copy it again"]),
    "hardly any rows": (whole(*record_lines(1, rows=3)), [RELAX, "3 data rows", "at least 4"]),
    "wrong delimiter": (
        whole(*[line.replace(",", "|") for line in record_lines(1)]),
        [RELAX, "only one column", "a comma"],
    ),
    "missing column": (
        header("time [s],displacement [mm],load [N]"),
        [RELAX, "no column is force; the file has 'time [s]', 'displacement [mm]', 'load [N]'",
         "of experiments.csv: time [s]; displacement [mm]; load [N] = force [N]"],
    ),
    "no column with a unit": (
        specimen(
            "name: strip A",
            "name: strip A\nrecord_format: {header_lines: 1, columns: [{name: a}, {name: b}, "
            "{name: c}]}",
        ),
        [RELAX, "no column is time or displacement or force; the file has 'a', 'b', 'c'. Put this "
         "into the column `columns` of experiments.csv, and replace each ?: ? = time [?]; "],
    ),
    "misspelt column": (
        header("time [s],displacment [mm],force [N]"),
        ["no column is displacement; the file has", "displacment [mm] = displacement [mm]; force"],
    ),
    "unknown unit": (header("time [s],displacement [mm],force [Nn]"), ["column force", "'Nn'"]),
    "wrong dimension": (
        header("time [s],displacement [kV],force [N]"),
        [RELAX, "column displacement", "'kV' is a voltage", "a length"],
    ),
    "no unit": (header("time [s],displacement,force [N]"), ["'displacement [m]'"]),
    "bracket without end": (
        header("time [s],displacement [mm,force [N]"),
        [RELAX, "the unit of column 'displacement [mm' has no end", "'displacement [mm]'"],
    ),
    "text behind the unit": (
        header("time [s],displacement [mm] (x1000),force [N]"),
        [
            RELAX,
            "the unit of column 'displacement [mm] (x1000)' has text behind it",
            "write 'displacement [mm]', and a factor as another unit",
        ],
    ),
    "unknown unit in round brackets": (
        header("time [s],displacement [mm],Force (Nn)"),
        ["the file has 'time [s]', 'displacement [mm]', 'Force (Nn)'", "Force (Nn) = force [?]"],
    ),
    "channel of another experiment": (
        header("time [s],displacement [mm],nominal_stress [kPa]"),
        ["no column is force; the file has", "replace each ?: ", "? = force [?]"],
    ),
    "decimal commas among points": (
        row(20, '1.9,60,"0,9"'),
        ["column force, data row 20: '0,9' has a decimal comma", "decimal point (1 such rows)"],
    ),
    "time goes back": (row(20, "0.5,60,0.9"), ["column time", "data row 20", "goes back"]),
    "time repeats": (row(20, "1.8,60,0.9"), ["column time", "data row 20 repeats", "remove"]),
    "NaN": (row(20, "1.9,60,NaN"), ["column force", "data row 20", "repair"]),
    "infinite": (row(20, "1.9,inf,0.9"), ["column displacement", "data row 20"]),
    "missing cell": (row(20, "1.9,,0.9"), ["column displacement", "infinite: 1", "data row 20"]),
    "text": (row(20, "1.9,60,overload"), ["column force, data row 20", "'overload'"]),
    "constant response": (column(2, "0.5"), ["column force", "constant", "check the sensor"]),
    "constant excitation": (column(1, "0"), ["column displacement", "constant"]),
    "outside the range": (
        header("time [s],displacement [m],force [N]"),
        ["column displacement", "beyond the instrument's range of 500 mm", "first in data row 2"],
    ),
    "beyond the sensor": (
        header("time [s],displacement [mm],force [kN]"),
        ["column force", "beyond the instrument's range of 10 N", "correct the column's unit"],
    ),
    "kilovolts as volts": (
        voltage("V", "2.0", "voltage_kV", "2.0"),
        [RELAX, "column voltage: comes to 2 V where experiments.csv says voltage_kV 2", "unit"],
    ),
    "volts as kilovolts": (
        voltage("kV", "2000", "voltage_kV", "2.0"),
        [RELAX, "comes to 2e+06 V where experiments.csv says voltage_kV 2"],
    ),
    "amplitude in kilovolts": (
        voltage("V", "2.0", "amplitude_kV", "1.0"),
        [RELAX, "comes to 1 V where experiments.csv says amplitude_kV 1"],
    ),
    "header not UTF-8": (
        lambda f: (f / "records" / RELAX).write_bytes(b"Zeit\xfc [s],a [m]\n0,1\n"),
        [RELAX, "line 1", "not UTF-8", "save the file"],
    ),
    "same record": (copy_record, ["'pull' holds the same values as calibrate record 'relax'"]),
    "unknown protocol": (table(",relaxation,", ",relaxatoin,"), ["line 2", "'relaxation'?"]),
    "protocol of another system": (table(",relaxation,", ",creep,"), ["line 2", "no model of"]),
    "unknown role": (table(",calibrate,", ",calibration,"), ["line 2, role", "'calibrate'?"]),
    "unknown excitation": (
        table("calibrate,displacement", "calibrate,displacment"),
        ["line 2 (relax)", "no excitation 'displacment'", "'displacement'?"],
    ),
    "unknown response": (table("force,first", "forse,first"), ["no response 'forse'", "'force'?"]),
    "missing table column": (
        table("role", "rolle"),
        ["column 'role' is missing", "'rolle' is not known: rename it 'role'?"],
    ),
    "missing table column unlike any": (
        table("role,", "for,"), ["column 'role' is missing; add it"],
    ),
    **{
        f"column {written}": (
            table("stretch_rate_per_s", written),
            [f"no model reads column {written!r}", f"did you mean {meant!r}?"],
        )
        for written, meant in {
            "Load_g": "load_g",
            "Bias_kV": "bias_kV",
            "frequency": "frequency_Hz",
            "Amplitude_kV": "amplitude_kV",
            "deformaton": "deformation",
            "Prehistory": "prehistory",
        }.items()
    },
    "same name twice": (table("pull,load", "Relax,load"), ["2 rows are named 'relax'"]),
    "bad name": (table("relax,relax", "re/lax,relax"), ["line 2, name", "'re/lax'"]),
    "comma in a note": (
        table("first,", "first, second, third"),
        ["line 2", 'a text that holds a comma in "quotation marks"'],
    ),
    "semicolon in a note": (
        lambda f: (f / "experiments.csv").write_text(
            TABLE.replace(",", ";").replace("first", "a; b; c")
        ),
        ["line 2", "a text that holds ';' in \"quotation marks\""],
    ),
    "no cell filled": (
        lambda f: write_lines(f / "experiments.csv", ['"",""', '"",""']),
        ["experiments.csv: the file is empty"],
    ),
    "no rows": (
        lambda f: write_lines(f / "experiments.csv", TABLE.splitlines()[:1]),
        ["experiments.csv: lists no record"],
    ),
    "no table": (lambda f: (f / "experiments.csv").unlink(), ["experiments.csv", "no such file"]),
    "unknown quantity": (specimen("gauge_length", "gage_length"), ["'gauge_length'?"]),
    "unknown system": (specimen("tensile_strip", "tensile"), ["system", "'tensile_strip'?"]),
    "unknown encoding": (
        specimen("name: strip A", "name: strip A\nrecord_format: {encoding: utf-32-foo}"),
        ["specimen.yaml, record_format.encoding: unknown encoding 'utf-32-foo'"],
    ),
    "stray quotation mark": (
        table("force,first", 'force,"first'),
        ["line 2", "a quotation mark has no end"],
    ),
    "empty specimen": (lambda f: (f / "specimen.yaml").write_text(""), ["specimen.yaml"]),
}  # fmt: skip


@pytest.mark.parametrize("case", BREAKS)
def test_bad_input_is_named_with_a_remedy(tmp_path: Path, case: str) -> None:
    folder = make_folder(tmp_path)
    break_it, words = BREAKS[case]
    break_it(folder)
    with pytest.raises(UserError) as caught:
        read_folder(folder)
    for word in words:
        assert word in str(caught.value)


def test_all_faults_of_a_folder_come_together(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    for case in ("unknown quantity", "NaN"):
        BREAKS[case][0](folder)
    replace_in(folder / "experiments.csv", "pull,load_unload", "pull,loading")
    with pytest.raises(Faults) as caught:
        read_folder(folder)
    text = str(caught.value)
    assert len(caught.value.faults) == 3
    assert "gage_length" in text
    assert "data row 20" in text
    assert "line 3, protocol" in text


def test_records_are_checked_on_reading_when_not_before(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    BREAKS["NaN"][0](folder)
    read = read_folder(folder, check_records=False)
    with pytest.raises(Faults, match="data row 20"):
        read.record(read.table[0])
    assert read.record(read.table[1]).columns["force"].size == 40


def test_a_file_for_a_folder(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    with pytest.raises(UserError, match=r"specimen\.yaml: is a file; name its folder .*strip$"):
        read_folder(folder / "specimen.yaml")
    with pytest.raises(UserError, match=r"relax\.csv: is a file; name its folder .*strip$"):
        read_folder(folder / "records" / "relax.csv")
