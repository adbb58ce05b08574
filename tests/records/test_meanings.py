"""What channels and quantities mean: known names only, and said in a new study's folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from deabayes.records.scaffold import new_study
from deabayes.systems import REGISTRY, system_class


def channels_and_quantities(kind: type) -> set[str]:
    parts = (
        kind.excitations,
        kind.responses,
        kind.required_quantities,
        kind.optional_quantities,
    )
    return {name for part in parts for name in part}


@pytest.mark.parametrize("system", sorted(REGISTRY))
def test_meanings_are_of_names_that_there_are(system: str) -> None:
    kind = system_class(system)
    known = channels_and_quantities(kind) | {"moving_mass"}
    assert kind.meanings and set(kind.meanings) <= known
    lengths = [name for name, unit in kind.required_quantities.items() if unit == "m"]
    assert set(lengths) <= set(kind.meanings)


@pytest.mark.parametrize("system", sorted(REGISTRY))
def test_a_new_study_says_them(system: str, tmp_path: Path) -> None:
    new_study("mine", system, tmp_path)
    specimen = (tmp_path / "mine" / "specimen.yaml").read_text(encoding="utf-8")
    columns = (tmp_path / "mine" / "records" / "README").read_text(encoding="utf-8")
    kind = system_class(system)
    for name in {**kind.required_quantities, **kind.optional_quantities}:
        (line,) = (x for x in specimen.splitlines() if x.lstrip(" #").startswith(f"{name}: "))
        meaning = kind.meanings.get(name, "")
        assert ("  # " in line[5:]) == (meaning not in ("", name))
        assert line.endswith(meaning) or meaning == name
    for name, unit in {**kind.excitations, **kind.responses}.items():
        said = f": {kind.meanings[name]}" if name in kind.meanings else ""
        assert f"    {name} [{unit}]{said}\n" in columns


@pytest.mark.parametrize(
    ("system", "header", "pulled"),
    [
        ("minimum_energy_structure", "displacement [mm],force [N],voltage [kV]", True),
        ("tubular", "time [s],voltage [kV],strain [1]", False),
        ("tensile_strip", "time [s],stretch [1],nominal_stress [kPa]", False),
    ],
)
def test_a_new_study_shows_columns_of_its_first_protocol(
    system: str, header: str, pulled: bool, tmp_path: Path
) -> None:
    new_study("mine", system, tmp_path)
    columns = (tmp_path / "mine" / "records" / "README").read_text(encoding="utf-8")
    assert f"\n    {header}\n" in columns
    assert ("or `voltage_kV` in experiments.csv" in columns) == pulled
    assert ("    control_voltage [V]: what was asked" in columns) == (system != "tensile_strip")
    specimen = (tmp_path / "mine" / "specimen.yaml").read_text(encoding="utf-8")
    listed = [x for x in specimen.splitlines() if x.startswith("#     - {name: ")]
    assert ",".join(x.split("name: ")[1].split(",")[0] for x in listed) == ",".join(
        x.split(" [")[0] for x in header.split(",")
    )
