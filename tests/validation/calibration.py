"""Simulation-based calibration: are the posteriors right as often as they say?

Draw parameters from the prior, simulate records, fit, and rank the truth among
the posterior draws; if everything is right the ranks are uniform (Talts et al.
2018). The ranks' empirical distribution is held against its 95 % simultaneous
band (Saeilynoja, Buerkner & Vehtari 2022). A sampler whose draws are too narrow
by a known factor must leave the band: the negative control.

    python -m tests.validation.calibration voigt_kelvin_2 --replicates 200

Rows are appended as replicates finish, so a stopped run goes on where it was.
"""

from __future__ import annotations

import argparse
import csv
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from multiprocessing import Pool
from pathlib import Path

import numpy as np

from deabayes.experiment import Excitation, Experiment, FloatArray, Quantity, Specimen
from deabayes.inference.log_posterior import LogPosterior, build
from deabayes.study import Settings, Study
from tests.validation.sampled import sample
from tests.validation.structure_worlds import at_rest

OUTPUT = Path("docs/validation")
RANKS = 99
NARROW = 0.7
SEED = 20261121


def tubular(candidate: str) -> LogPosterior:
    """A creep record of 0.5 s at 2 kV, 120 points on a geometric grid."""
    specimen = Specimen(
        "calibration",
        "tubular",
        {"kind": "simulated"},
        {
            "thickness": Quantity(80e-6, "m", 2e-6),
            "relative_permittivity": Quantity(3.1, "1", 0.1),
            "active_length": Quantity(0.07, "m"),
        },
    )
    # The default priors span materials of which half show one unit only in such a record;
    # these are what one knows of a silicone before the test.
    priors = {
        "E_0": {"distribution": "lognormal", "median": "1.5 MPa", "sigma": 0.3},
        "E_1": {"distribution": "lognormal", "median": "10 MPa", "sigma": 0.5},
        "E_2": {"distribution": "lognormal", "median": "10 MPa", "sigma": 0.5},
        "tau": {"distribution": "loguniform", "lower": "2 ms", "upper": "1 s"},
    }
    time = np.geomspace(1e-3, 0.5, 120)
    excitation = Excitation("voltage", "V", np.array([0.0, 1e-9, 0.5]), np.array([0, 2e3, 2e3]))
    return template(candidate, specimen, "creep", "strain", "1", time, excitation, priors)


def strip(candidate: str) -> LogPosterior:
    """A relaxation at stretch 2 after a ramp of 4 s, 120 points to 600 s."""
    specimen = Specimen("calibration", "tensile_strip", {"kind": "simulated"}, {})
    time = np.concatenate([np.linspace(0.2, 4.0, 20), 4.0 + np.geomspace(0.1, 596, 100)])
    excitation = Excitation("stretch", "1", np.array([0.0, 4.0, 600.0]), np.array([1.0, 2.0, 2.0]))
    return template(candidate, specimen, "relaxation", "nominal_stress", "Pa", time, excitation)


def template(
    candidate: str,
    specimen: Specimen,
    protocol: str,
    response: str,
    unit: str,
    time: FloatArray,
    excitation: Excitation,
    priors: Mapping[str, Settings] | None = None,
) -> LogPosterior:
    """The log-posterior for a typical record, whose response is the prior's median curve."""
    experiment = Experiment(
        "record", protocol, "calibrate", "time", "s", time, response, unit,
        np.linspace(0.0, 1.0, time.size), np.ones(time.size), excitation, provenance="simulated",
    )  # fmt: skip
    study = Study("calibration", Path(), (candidate,))
    first = build(study, candidate, specimen, [experiment])
    median = first.responses(first.prior.to_parameters(np.zeros((1, first.dimension))))["record"][0]
    return build(study, candidate, specimen, [replace(experiment, response=median)])


def structure(candidate: str) -> LogPosterior:
    """Forces at 57 displacements under 0 and 5 kV: `structure_worlds.at_rest`."""
    return at_rest().target(int(candidate.removeprefix("ogden_")))


FAMILIES = {"voigt_kelvin_2": tubular, "kv_gm_1": strip, "ogden_1": structure}


def simulate(target: LogPosterior, rng: np.random.Generator) -> tuple[FloatArray, LogPosterior]:
    """Truth z (d,) from the prior, and the log-posterior given records simulated with it."""
    while True:
        z = rng.standard_normal((1, target.dimension))
        theta = target.prior.to_parameters(z)
        responses = target.responses(theta)
        if all(np.all(np.isfinite(response)) for response in responses.values()):
            break
    records = []
    for record in target.records:
        draws = target.noise_draws(target.draws(theta), record.group)
        correlated, white = target.noise.sample(
            rng, record.experiment.coordinate, record.weights, draws
        )
        response = responses[record.experiment.name]
        noisy = record.scale.with_residuals(response, correlated + white)[0]
        records.append(replace(record, experiment=replace(record.experiment, response=noisy)))
    return z[0], replace(target, records=tuple(records))


def replicate(task: tuple[str, int]) -> dict[str, object]:
    """Ranks of the truth, from one simulated data set."""
    candidate, index = task
    target = FAMILIES[candidate](candidate)
    stream = np.random.SeedSequence([SEED, zlib.crc32(candidate.encode()), index])
    data_stream, fit_stream, pick_stream = stream.spawn(3)
    truth, conditioned = simulate(target, np.random.default_rng(data_stream))
    found = sample(conditioned, fit_stream).found
    rng = np.random.default_rng(pick_stream)
    flat = found.chain.reshape(-1, target.dimension)
    picked = flat[rng.choice(len(flat), RANKS, replace=False)]
    narrow = flat.mean(0) + NARROW * (picked - flat.mean(0))
    low, high = np.quantile(flat, [0.05, 0.95], axis=0)
    row: dict[str, object] = {"replicate": index, "steps": found.steps}
    row["enough"] = int(found.convergence.converged)
    for column, name in enumerate(target.names):
        row[name] = int(np.sum(picked[:, column] < truth[column]))
        row[f"narrow:{name}"] = int(np.sum(narrow[:, column] < truth[column]))
        row[f"covered:{name}"] = int(low[column] <= truth[column] <= high[column])
    return row


def run(candidate: str, replicates: int, processes: int) -> Path:
    """Append the missing replicates to docs/validation/calibration_{candidate}.csv."""
    path = OUTPUT / f"calibration_{candidate}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    done = {int(row["replicate"]) for row in read(path)} if path.exists() else set()
    tasks = [(candidate, i) for i in range(replicates) if i not in done]
    with Pool(processes) as pool, path.open("a", newline="", encoding="utf-8") as stream:
        writer: csv.DictWriter[str] | None = None
        for count, row in enumerate(pool.imap_unordered(replicate, tasks), 1):
            if writer is None:
                writer = csv.DictWriter(stream, list(row))
                if not done:
                    writer.writeheader()
            writer.writerow(row)
            stream.flush()
            print(f"{candidate}: {len(done) + count}/{replicates}", flush=True)
    return path


def read(path: Path) -> Iterator[dict[str, str]]:
    with path.open(encoding="utf-8") as stream:
        yield from csv.DictReader(stream)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("candidate", choices=sorted(FAMILIES))
    parser.add_argument("--replicates", type=int, default=200)
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    run(arguments.candidate, arguments.replicates, arguments.processes)


if __name__ == "__main__":
    main()
