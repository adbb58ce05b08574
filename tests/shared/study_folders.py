"""A small sound study folder to break in one place at a time; where the shipped ones are."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from deabayes.faults import Report
from deabayes.records.folder import scan_folder

SPECIMEN = """\
name: strip A
system: tensile_strip
provenance: {kind: measured, source: laboratory, licence: CC0}
quantities:
  gauge_length: {value: 80, unit: mm, source: ruler}
  cross_section: {value: 22, unit: mm^2, sd: 1.1, source: caliper}
instruments:
  force: {noise: {value: 1, unit: mN}, range: {value: 10, unit: N}}
  displacement: {range: {value: 500, unit: mm}}
"""
TABLE = """\
name,protocol,record,role,excitation,response,note,stretch_rate_per_s
relax,relaxation,records/relax.csv,calibrate,displacement,force,first,
pull,load_unload,records/pull.csv,validate,displacement,force,,0.25
"""
HEADER = "time [s],displacement [mm],force [N]"
SPECIMENS = Path(__file__).parents[2] / "data"
"""The shipped folders."""


def record_lines(seed: int, rows: int = 40) -> list[str]:
    """Header and rows of a made-up pull: time, displacement, force with noise."""
    rng = np.random.default_rng(seed)
    time = 0.1 * np.arange(rows)
    displacement = np.minimum(20.0 * time, 60.0)
    force = 1.5 * (1 - np.exp(-displacement / 40.0)) + 1e-3 * rng.normal(size=rows)
    table = np.column_stack([time, displacement, force])
    return [HEADER, *(f"{t:.4f},{d:.4f},{f:.5f}" for t, d, f in table)]


def write_lines(path: Path, lines: list[str]) -> Path:
    """Write the lines, each ended by a newline."""
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    return path


def make_folder(parent: Path) -> Path:
    """A sound study folder with one relaxation and one load-unload record."""
    folder = parent / "strip"
    (folder / "records").mkdir(parents=True)
    (folder / "specimen.yaml").write_text(SPECIMEN, encoding="utf-8")
    (folder / "experiments.csv").write_text(TABLE, encoding="utf-8")
    write_lines(folder / "records" / "relax.csv", record_lines(1))
    write_lines(folder / "records" / "pull.csv", record_lines(2))
    return folder


def replace_in(path: Path, old: str, new: str) -> None:
    """Replace a text that must be there."""
    text = path.read_text(encoding="utf-8")
    assert old in text, f"{old!r} is not in {path}"
    path.write_text(text.replace(old, new), encoding="utf-8")


CONFIG = """\
studies:
  vhb:
    specimen: strip
    candidates: [kv_gm_1, kv_gm_2]
    calibrate: [relax]
    validate: [pull]
    noise_scale: range
    preparation:
      relaxation: [{mask_before: {time: 0.1 s}}, {average: {points: 20}}]
      load_unload: [average]
    priors: {mu_alpha: {distribution: lognormal, median: 35 kPa, sigma: 0.5}}
    further_experiments: {longer: {like: relax, duration: 2}}
    evidence_check: nested
    sampling: {walkers: 64}
sampling: {ensembles: 2, walkers: 32, seed: 7, r_hat: 1.02}
data_root: ../public
"""


def make_config(folder: Path) -> Path:
    """A config with settings of every kind beside a study folder."""
    make_folder(folder)
    path = folder / "config.yaml"
    path.write_text(CONFIG, encoding="utf-8")
    return path


def faults_of(folder: Path) -> list[str]:
    """Every fault of a study folder and its records."""
    report = Report()
    scan_folder(folder, report)
    return report.faults
