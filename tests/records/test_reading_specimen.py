"""specimen.yaml: units, instruments, and every fault with its key."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from tests.shared.study_folders import make_folder, replace_in

from deabayes.faults import Faults, UserError
from deabayes.records.columns import CHANNELS
from deabayes.records.schema import read_yaml, schema
from deabayes.records.specimen import read_specimen, specimen_from_quantities
from deabayes.systems.specimen_quantities import PROPERTIES, instrument


def test_quantities_and_instruments_in_si(tmp_path: Path) -> None:
    specimen = read_specimen(make_folder(tmp_path))
    area = specimen.quantities["cross_section"]
    assert (area.value, area.unit) == (pytest.approx(22e-6), "m^2")
    assert area.sd == pytest.approx(1.1e-6)
    assert specimen.quantities["gauge_length"].sd is None
    assert specimen.provenance["licence"] == "CC0"
    noise = instrument(specimen, "noise", "force", "N")
    assert noise is not None
    assert noise.value == pytest.approx(1e-3)
    assert instrument(specimen, "noise", "displacement", "m") is None


def test_general_instrument_serves_channels_of_its_dimension(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "  force: {", "  range: {value: 3, unit: N}\n  current: {")
    replace_in(folder / "specimen.yaml", "unit: mN", "unit: mA")
    replace_in(folder / "specimen.yaml", "value: 10, unit: N", "value: 10, unit: A")
    specimen = read_specimen(folder)
    assert instrument(specimen, "range", "force", "N").value == 3.0  # type: ignore[union-attr]
    assert instrument(specimen, "range", "voltage", "V") is None
    assert instrument(specimen, "range", "displacement", "m").value == 0.5  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("system: tensile_strip", "system: tensile_stripe", ["system", "'tensile_strip'?"]),
        ("gauge_length:", "gage_length:", ["quantities.gage_length", "'gauge_length'?"]),
        ("value: 80, unit: mm", "value: 80, unit: mV", ["quantities.gauge_length", "a voltage"]),
        ("value: 80, unit: mm", "value: 80, unit: mmm", ["gauge_length", "unknown unit 'mmm'"]),
        ("value: 80,", "value: eighty,", ["gauge_length.value", "a number", "'eighty'"]),
        ("value: 80, unit: mm", "value: 80", ["gauge_length", "'unit' is missing"]),
        ("value: 80,", "value: 0,", ["quantities.gauge_length", "must be positive", "0 mm"]),
        ("sd: 1.1", "sd: -1.1", ["cross_section.sd", "must be > 0", "-1.1"]),
        ("sd: 1.1", "sd: .inf", ["cross_section.sd", "positive number", "inf"]),
        ("sd: 1.1", "sd: .nan", ["cross_section.sd", "positive number", "nan"]),
        ("instruments:", "instruments:\n  delay: {value: -3, unit: ms}",
         ["instruments.delay", "zero or positive", "-3 ms"]),
        ("instruments:", "instruments:\n  delay: {value: 3, unit: ms, sd: 1}",
         ["instruments.delay", "exact, found sd 1", "quantities.sensor_delay"]),
        ("unit: mN}", "unit: mN, sd: 0.1}", ["instruments.force.noise", "exact", "remove it"]),
        ("instruments:", "instruments:\n  delay: {value: .nan, unit: ms}",
         ["instruments.delay", "zero or positive", "nan ms"]),
        ("{value: 10, unit: N}", "{value: -3, unit: N}", ["force.range", "positive", "-3 N"]),
        ("{value: 10, unit: N}", "{value: 0, unit: N}", ["force.range", "positive", "0 N"]),
        ("noise: {value: 1,", "noise: {value: .inf,", ["force.noise", "positive", "inf mN"]),
        ("instruments:", "instruments:\n  noise: {value: 1, unit: kV}",
         ["instruments.noise", "'kV'", "'tensile_strip'", "Pa, N"]),
        ("sd: 1.1", "std: 1.1", ["cross_section", "unknown key 'std'", "'sd'?"]),
        ("kind: measured", "kind: measurd", ["provenance.kind", "'measured'?"]),
        ("name: strip A\n", "", ["'name' is missing"]),
        ("name: strip A\n", "name: strip A\nquantites: {}\n", ["'quantites'", "'quantities'?"]),
        ("force: {noise", "forse: {noise", ["instruments", "'forse'", "'force'?"]),
        ("{noise: {value: 1, unit: mN}", "{noise: {value: 1, unit: m}", ["force.noise", "a force"]),
        ("system: tensile_strip", "system: [tensile_strip", ["specimen.yaml, line"]),
        ("name: strip A\n", "name: a\nname: b\n", ["line 2", "'name' is given twice"]),
    ],
)  # fmt: skip
def test_faults_name_the_key_and_the_remedy(
    tmp_path: Path, old: str, new: str, words: list[str]
) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", old, new)
    with pytest.raises(UserError) as caught:
        read_specimen(folder)
    for word in ["specimen.yaml", *words]:
        assert word in str(caught.value)


def test_missing_quantity_is_asked_for(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "system: tensile_strip", "system: tubular")
    with pytest.raises(Faults, match=r"requires 'thickness'; add thickness: \{value: "):
        read_specimen(folder)


def test_all_faults_come_together(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    replace_in(folder / "specimen.yaml", "gauge_length", "gage_length")
    replace_in(folder / "specimen.yaml", "unit: mm^2", "unit: kg")
    with pytest.raises(Faults) as caught:
        read_specimen(folder)
    assert len(caught.value.faults) == 2


def test_missing_and_undecodable_files(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    (folder / "specimen.yaml").write_bytes("name: Stück".encode("latin-1"))
    with pytest.raises(UserError, match=r"specimen\.yaml: is not UTF-8 \(byte 0xfc\)"):
        read_specimen(folder)
    (folder / "specimen.yaml").write_text("")
    with pytest.raises(UserError, match=r"specimen\.yaml: expected `key: value` lines, found noth"):
        read_specimen(folder)
    (folder / "specimen.yaml").unlink()
    with pytest.raises(UserError, match=r"specimen\.yaml: there is no such file"):
        read_specimen(folder)


def test_numbers_with_bare_exponents_are_numbers(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("a: 1e-3\nb: 4.11e-11\nc: 1.5e3\nd: e3\nf: 2024-01-01\n")
    content = read_yaml(path)
    assert (content["a"], content["b"], content["c"]) == (1e-3, 4.11e-11, 1.5e3)
    assert content["d"] == "e3"


def test_specimen_from_a_mapping() -> None:
    quantities = {"gauge_length": "80 mm", "cross_section": {"value": 22, "unit": "mm^2", "sd": 1}}
    specimen = specimen_from_quantities("tensile_strip", quantities)
    assert specimen.quantities["gauge_length"].value == pytest.approx(0.08)
    assert specimen.quantities["cross_section"].sd == pytest.approx(1e-6)
    with pytest.raises(Faults, match=r"gauge: system 'tensile_strip' has no such quantity"):
        specimen_from_quantities("tensile_strip", {"gauge": 0.08})


@pytest.mark.parametrize("name", ["specimen", "experiments", "config"])
def test_every_key_of_the_schemas_is_described(name: str) -> None:
    def undescribed(node: object, path: str) -> list[str]:
        if isinstance(node, list):
            return [p for item in node for p in undescribed(item, path)]
        if not isinstance(node, dict):
            return []
        found = [
            f"{path}.{key}"
            for key, child in node.get("properties", {}).items()
            if "description" not in child and "$ref" not in child
        ]
        return found + [p for key, child in node.items() for p in undescribed(child, key)]

    assert undescribed(schema(name), name) == []


def test_schema_knows_all_channels_and_properties() -> None:
    instruments = schema("specimen")["properties"]["instruments"]["properties"]
    assert set(instruments) == {*PROPERTIES, *CHANNELS} - {"time"}


def test_example_is_valid_yaml() -> None:
    from tests.shared.study_folders import SPECIMEN

    assert yaml.safe_load(SPECIMEN)["name"] == "strip A"


def test_an_edited_file_is_read_again(tmp_path):
    folder = make_folder(tmp_path)
    before = read_specimen(folder)
    path = folder / "specimen.yaml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(f"name: {before.name}", "name: another"), encoding="utf-8")
    assert read_specimen(folder).name == "another"
    assert before.name != "another"
