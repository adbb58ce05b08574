"""Make a study of a moving actuator from simulated records: python vibration_study.py FOLDER.

FOLDER gets data/isolator and config.yaml. Truth: a voigt_kelvin_2_inertia_circuit with
the quantities of the shipped data/tubular, without load; a sensor with 30 um of white noise.
"""

import sys
from pathlib import Path

import numpy as np
import yaml

import deabayes

SHIPPED = Path(__file__).parents[2] / "data/tubular/specimen.yaml"
TRUTH = {"E_0": 1.5e6, "E_1": 12e6, "E_2": 6e6, "tau_1": 6e-3, "tau_2": 0.12}
CANDIDATE = "voigt_kelvin_2_inertia_circuit"
PROVENANCE = {"kind": "simulated", "source": f"{CANDIDATE}, {TRUTH}", "licence": "CC0"}
CONFIG = f"""\
studies:
  isolator:
    specimen: data/isolator
    candidates: [{CANDIDATE}]
    noise: white
    preparation: {{creep: []}}
    sampling: {{walkers: 64, particles: 512}}
"""
TABLE = """\
name,protocol,record,role,excitation,response,load_g
creep_2000V,creep,records/creep_2000V.csv,calibrate,voltage,displacement,0
creep_1500V,creep,records/creep_1500V.csv,validate,voltage,displacement,0
"""


def record(voltage: float, rng: np.random.Generator) -> np.ndarray:
    """Time [s], amplifier voltage [V] and measured displacement [m] of a step at 10 ms."""
    time = 1e-3 * np.arange(250)
    step = np.where(time < 0.01, 0.0, voltage)
    simulated = deabayes.simulate(
        "tubular",
        CANDIDATE,
        TRUTH,
        SHIPPED.parent,
        time,
        "displacement",
        {"load_g": 0},
        voltage=step,
    )
    return np.column_stack([time, step, simulated.displacement + 30e-6 * rng.normal(size=250)])


def main(folder: Path) -> None:
    """Write the study."""
    records = folder / "data/isolator/records"
    records.mkdir(parents=True)
    rng = np.random.default_rng(1)
    for voltage in (2000, 1500):
        np.savetxt(
            records / f"creep_{voltage}V.csv", record(voltage, rng), "%.9g", ",",
            header="time [s],voltage [V],displacement [m]", comments="",
        )  # fmt: skip
    specimen = yaml.safe_load(SHIPPED.read_text(encoding="utf-8"))
    specimen |= {"name": "isolator", "instruments": {}, "provenance": PROVENANCE}
    text = yaml.safe_dump(specimen, sort_keys=False)
    (records.parent / "specimen.yaml").write_text(text, encoding="utf-8")
    (records.parent / "experiments.csv").write_text(TABLE, encoding="utf-8")
    (folder / "config.yaml").write_text(CONFIG, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
