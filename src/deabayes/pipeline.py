"""The line from raw records to a report, one function per stage.

The command line and the workflow's rules call these; each reads files, calls
the layers below and writes files, nothing else.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deabayes.experiment import Experiment
from deabayes.faults import UserError, nearest
from deabayes.reading.raw import ExperimentRow
from deabayes.study import Study, to_settings

if TYPE_CHECKING:
    from deabayes.posterior import LogPosterior
    from deabayes.prior import PriorFromPosterior

PREDICTION_DRAWS = 1000
ANNEALED_DRAWS = 512


def seed_of(study: Study, candidate: str, stage: str, index: int = 0) -> np.random.SeedSequence:
    """One explicit stream per (seed, study, candidate, stage, index)."""
    words = [zlib.crc32(text.encode()) for text in (study.name, candidate, stage)]
    return np.random.SeedSequence([study.sampling.seed, *words, index])


def prepare_study(study: Study, output: Path) -> list[Experiment]:
    """Read, check and prepare every record of a study into `output/{experiment}.nc`."""
    from deabayes.preparation import prepare
    from deabayes.preparation.prepared import write_prepared
    from deabayes.reading.folder import read_folder

    folder = read_folder(study.specimen, study.data_root)
    rows = select_rows(study, folder.table)
    output.mkdir(parents=True, exist_ok=True)
    experiments = []
    for row in rows:
        raw = folder.record(row)
        experiment = prepare(row, raw, folder.specimen, study.preparation.get(row.protocol))
        unseen = [w for w in folder.warnings(row) if w not in experiment.warnings]
        experiment = replace(experiment, warnings=(*experiment.warnings, *unseen))
        write_prepared(experiment, output / f"{experiment.name}.nc", raw)
        experiments.append(experiment)
    return experiments


def read_experiments(prepared: Path) -> list[Experiment]:
    """All prepared records of a study, by name."""
    from deabayes.preparation.prepared import read_prepared

    paths = sorted(Path(prepared).glob("*.nc"))
    if not paths:
        raise UserError(f"{prepared}: holds no prepared record; run `deabayes prepare` first")
    return [read_prepared(path) for path in paths]


def select_rows(study: Study, rows: Sequence[ExperimentRow]) -> list[ExperimentRow]:
    """The rows a study uses, with the roles the study gives them.

    `calibrate` and `validate` of the study override the role column; `select`
    keeps the rows whose metadata column has the wanted value.
    """
    kept = [
        row
        for row in rows
        if all(str(row.metadata.get(column)) == value for column, value in study.select.items())
    ]
    known = [row.name for row in kept]
    for key, names in (("calibrate", study.calibrate), ("validate", study.validate)):
        for name in names or ():
            if name not in known:
                raise UserError(
                    f"study {study.name}, {key}: {name!r} is no experiment of "
                    f"{study.specimen}{nearest(name, known)}"
                )
    calibrate = study.calibrate or [row.name for row in kept if row.role == "calibrate"]
    validate = study.validate or [row.name for row in kept if row.role == "validate"]
    if not calibrate:
        raise UserError(
            f"study {study.name}: {study.specimen} has no record to calibrate on; give one the "
            "role `calibrate` in experiments.csv, or list names under `calibrate:`"
        )
    chosen = [replace(row, role="calibrate") for row in kept if row.name in calibrate]
    return chosen + [
        replace(row, role="validate")
        for row in kept
        if row.name in validate and row.name not in calibrate
    ]


def fit_ensemble(
    study: Study, candidate: str, prepared: Path, ensemble: int, output: Path, progress: bool
) -> None:
    """Run one independent ensemble of a candidate, resuming where a killed run stopped."""
    from deabayes.sampling import run_ensemble

    target = build_target(study, candidate, prepared)
    result = run_ensemble(
        target.log_likelihood_of_normal,
        target.dimension,
        study.sampling,
        seed_of(study, candidate, "ensemble", ensemble),
        chain_folder(study, candidate, prepared, output.parent.parent) / f"ensemble_{ensemble}",
        progress,
    )
    result.write(output)


def pool_candidate(
    study: Study,
    candidate: str,
    prepared: Path,
    ensembles: Sequence[Path],
    output: Path,
    summary: Path,
    progress: bool,
) -> None:
    """Judge the ensembles together, sample on if a gate fails, write posterior.nc and summary.csv."""
    from deabayes import sampling
    from deabayes.ensemble import Ensemble
    from deabayes.posterior_file import PosteriorContent, posterior_tree, quantities
    from deabayes.storage import write_atomically, write_tree

    target = build_target(study, candidate, prepared)
    pooled = sampling.pool(
        target.log_likelihood_of_normal,
        [Ensemble.read(path) for path in ensembles],
        study.sampling,
        seed_of(study, candidate, "pool"),
        chain_folder(study, candidate, prepared, output.parent) / "pool",
        progress,
        quantities=lambda z: quantities(target, target.prior.to_parameters(z)),
    )
    content = PosteriorContent.of(
        study, candidate, target, pooled, seed_of(study, candidate, "prior")
    )
    tree = posterior_tree(content)
    table = tree["summary"].to_dataset().to_dataframe().rename_axis("parameter")
    write_tree(tree, output)
    write_atomically(lambda path: table.to_csv(path), summary)


def build_target(study: Study, candidate: str, prepared: Path) -> LogPosterior:
    """The log-posterior of a candidate over a study's prepared records."""
    from deabayes.posterior import build
    from deabayes.reading.specimen import read_specimen

    specimen = read_specimen(study.specimen)
    return build(study, candidate, specimen, read_experiments(prepared), inherited_prior(study))


def inherited_prior(study: Study) -> PriorFromPosterior | None:
    """The posterior that `prior_from` names, as a prior."""
    from deabayes.api import open_posterior

    return None if study.prior_from is None else open_posterior(study.prior_from).as_prior()


def chain_folder(study: Study, candidate: str, prepared: Path, results: Path) -> Path:
    """Where a candidate's chains live: keyed by data, settings and code, so that stale ones are never resumed."""
    package = Path(__file__).parent
    digest = hashlib.sha256(candidate.encode())
    settings = json.dumps(to_settings(study), sort_keys=True, default=str)
    digest.update(settings.encode())
    above = {"figures", "report", "export"}
    for path in [*sorted(package.rglob("*.py")), *sorted(Path(prepared).glob("*.nc"))]:
        if path.parent.name not in above:
            digest.update(path.read_bytes())
    return results / ".chain" / digest.hexdigest()[:16]


def predict_candidate(posterior: Path, prepared: Path, output: Path, errors: Path) -> None:
    """Predict every record of the study; write predictions/{experiment}.nc and errors.csv."""
    import pandas as pd

    from deabayes.errors_table import error_row
    from deabayes.fitted import Fitted
    from deabayes.prediction import to_dataset
    from deabayes.storage import read_tree, write_atomically, write_dataset

    tree = read_tree(posterior)
    fitted = Fitted.from_tree(tree, size=PREDICTION_DRAWS, seed=1)
    rows = []
    for index, experiment in enumerate(read_experiments(prepared)):
        rng = np.random.default_rng([1, index])
        samples = fitted.sample(experiment, rng)
        flags = fitted.extrapolation(experiment)
        attributes = {
            "extrapolation": flags,
            "converged": int(fitted.converged),
            "noise_group": fitted.noise_of(experiment)[0],
            "candidate": fitted.candidate,
        }
        write_dataset(to_dataset(experiment, samples, attributes), output / f"{experiment.name}.nc")
        rows.append(error_row(experiment, samples, flags))
    table = pd.DataFrame(rows).sort_values(["role", "protocol", "experiment"])
    write_atomically(lambda path: table.to_csv(path, index=False), errors)


def score_candidate(posterior: Path, prepared: Path, output: Path) -> None:
    """Evidence, BIC and leave-one-experiment-out score of one candidate: scores.json."""
    from deabayes import scoring
    from deabayes.storage import read_tree, write_atomically
    from deabayes.study import from_settings

    tree = read_tree(posterior)
    study = from_settings(json.loads(tree.attrs["study"]))
    candidate = tree.attrs["candidate"]
    target = build_target(study, candidate, prepared)
    z = tree["unconstrained_posterior"]["z"].values
    ess = float(tree["summary"]["ess_bulk"].min()) / z.shape[0]
    evidence = scoring.bridge_evidence(
        target, z, ess, seed_of(study, candidate, "evidence"), components=4
    )
    flat = z.reshape(-1, z.shape[2])
    best = flat[np.argsort(tree["sample_stats"]["lp"].values.reshape(-1))[-3:]]
    maximum = scoring.maximum_log_likelihood(target, best)
    points = sum(r.experiment.coordinate.size for r in target.records)
    thinned = flat[np.linspace(0, len(flat) - 1, ANNEALED_DRAWS).astype(int)]
    left_out = scoring.leave_one_experiment_out(
        target, thinned, seed_of(study, candidate, "leave one experiment out")
    )
    content = {
        "log_evidence": evidence.log_evidence,
        "log_evidence_mcse": evidence.mcse,
        "log_evidence_estimates": evidence.estimates,
        "maximum_log_likelihood": maximum,
        "bic": target.dimension * float(np.log(points)) - 2.0 * maximum,
        "elpd_leave_one_experiment_out": sum(left_out.values()) if left_out else float("nan"),
        "left_out": left_out,
    }
    write_atomically(lambda path: path.write_text(json.dumps(content, indent=1)), output)


def compare_candidates(posteriors: Sequence[Path], prepared: Path, output: Path) -> None:
    """Rank the candidates of a study: comparison.csv."""
    from deabayes.ranking import Ranked, comparison_table
    from deabayes.storage import read_tree, write_atomically
    from deabayes.study import from_settings

    ranked = []
    for posterior in posteriors:
        tree = read_tree(posterior)
        study = from_settings(json.loads(tree.attrs["study"]))
        target = build_target(study, tree.attrs["candidate"], prepared)
        scores = json.loads(posterior.with_name("scores.json").read_text())
        ranked.append(Ranked(tree, target, scores))
    table = comparison_table(ranked)
    write_atomically(lambda path: table.to_csv(path, index=False), output)


def draw_figures(results: Path, output: Path) -> None:
    """Draw every registered figure of a study."""
    from deabayes.figures import save_all

    save_all(results, output)


def build_report(
    folders: Sequence[Path], output: Path, tables: Path, left_out: Sequence[str]
) -> None:
    """Build the report page and its tables."""
    from deabayes.report import build

    build(folders, output, tables, left_out)


def export_posterior(posterior: Path, to: str, output: Path) -> None:
    """Write a posterior's draws in another program's format."""
    from deabayes.export import export
    from deabayes.storage import read_tree

    export(read_tree(posterior), to, output)
