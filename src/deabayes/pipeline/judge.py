"""From posteriors to scores, predictions, errors, comparisons and further experiments."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from deabayes.faults import Faults, UserError
from deabayes.files import write_atomically, write_text_atomically
from deabayes.pipeline.fit import inherited_prior, seed_of, stored_target
from deabayes.pipeline.prepare import read_experiments
from deabayes.study import Settings, from_settings

if TYPE_CHECKING:
    from deabayes.posteriors.fitted import Fitted
    from deabayes.study import Study

PREDICTION_DRAWS = 1000
BRIDGE_DRAWS = 1000
"""Of each ensemble: the evidence is known to some hundredths of a nat then."""


def score_candidate(posterior: Path, prepared: Path, output: Path) -> None:
    """Evidence and BIC of one candidate: scores.json."""
    from deabayes.comparison.evidence import bridge_evidence, maximum_log_likelihood
    from deabayes.posteriors.problem import split_log_likelihood
    from deabayes.posteriors.storage import read_tree

    tree = read_tree(posterior)
    study, target = stored_target(tree, prepared)
    candidate = tree.attrs["candidate"]
    z = tree["unconstrained_posterior"]["z"].values
    ess = float(tree["summary"]["ess_bulk"].min()) / z.shape[0]
    bridged = z[:, np.linspace(0, z.shape[1] - 1, min(BRIDGE_DRAWS, z.shape[1])).astype(int)]
    evidence = bridge_evidence(
        target, bridged, ess, seed_of(study, candidate, "evidence"), components=4
    )
    flat = z.reshape(-1, z.shape[2])
    maximum = maximum_log_likelihood(lambda z: split_log_likelihood(target, z), flat)
    points = sum(r.experiment.coordinate.size for r in target.records)
    content = {
        "log_evidence": evidence.log_evidence,
        "log_evidence_mcse": evidence.mcse,
        "log_evidence_estimates": evidence.estimates,
        "maximum_log_likelihood": maximum,
        "bic": target.dimension * float(np.log(points)) - 2.0 * maximum,
    }
    write_text_atomically(json.dumps(content, indent=1), output)


def check_evidence(posterior: Path, prepared: Path, output: Path) -> None:
    """Evidence of one candidate by nested sampling: nested.json."""
    from deabayes.comparison.nested import nested
    from deabayes.posteriors.storage import read_tree

    tree = read_tree(posterior)
    study, target = stored_target(tree, prepared)
    seed = seed_of(study, tree.attrs["candidate"], "nested sampling")
    results, cpu = nested(target.log_likelihood_of_normal, target.dimension, seed)
    content = {
        "log_evidence_nested": float(results.logz[-1]),
        "log_evidence_nested_error": float(results.logzerr[-1]),
        "evaluations": int(np.sum(results.ncall)),
        "cpu_seconds": round(cpu, 1),
    }
    write_text_atomically(json.dumps(content, indent=1), output)


def predict_candidate(posterior: Path, prepared: Path, output: Path, errors: Path) -> list[str]:
    """Predict every record of the study; write predictions/{experiment}.nc and errors.csv.

    Predictions of records that the study no longer has are removed.

    Returns a sentence on every record to which some draws have no response.
    """
    import pandas as pd

    from deabayes.posteriors.fitted import Fitted
    from deabayes.posteriors.records import check_fitted_records
    from deabayes.posteriors.storage import read_tree, sum_of_draws, write_datasets
    from deabayes.prediction.bands import to_dataset
    from deabayes.prediction.errors import SCORED_DRAWS, error_row

    tree = read_tree(posterior, ("posterior", "observed_data"))
    experiments = read_experiments(prepared)
    check_fitted_records(tree, experiments)
    fitted = Fitted.from_tree(tree, size=PREDICTION_DRAWS, seed=1)
    draws = sum_of_draws(tree)
    datasets, rows, failures = {}, [], []
    for index, experiment in enumerate(experiments):
        rng = np.random.default_rng([1, index])
        samples = fitted.sample(experiment, rng)
        flags = fitted.extrapolation(experiment)
        attributes = {
            "extrapolation": flags,
            "converged": int(fitted.converged),
            "noise_group": fitted.noise_of(experiment).group,
            "candidate": fitted.candidate,
        }
        datasets[experiment.name] = to_dataset(experiment, samples, attributes)
        rows.append(error_row(experiment, samples, flags) | {SCORED_DRAWS: draws})
        if samples.failure:
            failures.append(f"{fitted.candidate}, {experiment.name}: {samples.failure}")
    write_datasets(datasets, output, mark="experiment")
    table = pd.DataFrame(rows).sort_values(["role", "protocol", "experiment"])
    write_atomically(lambda path: table.to_csv(path, index=False), errors)
    return failures


def compare_candidates(posteriors: Sequence[Path], prepared: Path, output: Path) -> None:
    """Rank the candidates of a study: comparison.csv."""
    from deabayes.comparison.ranking import Ranked, comparison_table
    from deabayes.posteriors.storage import read_tree

    ranked = []
    for posterior in posteriors:
        tree = read_tree(posterior)
        study, target = stored_target(tree, prepared)
        ranked.append(Ranked(tree, target, _scores_of(posterior) | _nested_of(posterior)))
    table = comparison_table(ranked, seed_of(study, "all candidates", "left-out blocks"))
    write_atomically(lambda path: table.to_csv(path, index=False), output)


def _scores_of(posterior: Path) -> dict[str, Any]:
    """Read scores.json beside a posterior."""
    path = posterior.with_name("scores.json")
    try:
        content: dict[str, Any] = json.loads(path.read_text())
    except json.JSONDecodeError as error:
        raise UserError(f"{path}: is no JSON ({error}); remove it and compare again") from None
    return content


def _nested_of(posterior: Path) -> dict[str, float]:
    """Read the evidence by nested sampling, if it is newer than the posterior."""
    found = posterior.with_name("nested.json")
    if not found.is_file() or found.stat().st_mtime < posterior.stat().st_mtime:
        return {}
    content: dict[str, float] = json.loads(found.read_text())
    return content


DRAWS = 500


def further_experiments(results: Path, asked: Mapping[str, Settings], output: Path) -> None:
    """Compare possible further experiments; write further_experiments.csv.

    Parameters
    ----------
    results : `results/{study}` with prepared records, posteriors and the comparison.
    asked : `further_experiments` of the study.
    """
    import pandas as pd

    from deabayes.comparison.further import contenders, further_table, plan
    from deabayes.posteriors.fitted import Fitted
    from deabayes.posteriors.storage import read_tree

    comparison = results / "comparison.csv"
    if not comparison.is_file():
        raise UserError(f"{comparison}: no such file; run `deabayes compare {results.name}` first")
    planned = plan(read_experiments(results / "prepared"), asked)
    names = contenders(pd.read_csv(comparison))
    trees = [read_tree(results / name / "posterior.nc", ("posterior",)) for name in names]
    fitted = {
        name: Fitted.from_tree(t, DRAWS, seed=1) for name, t in zip(names, trees, strict=True)
    }

    def seed(experiment: str) -> np.random.SeedSequence:
        study = from_settings(json.loads(trees[0].attrs["study"]))
        return seed_of(study, experiment, "further experiment")

    table = further_table(planned if trees else [], fitted, seed)
    write_atomically(lambda path: table.to_csv(path, index=False), output)


def entries_of(asked: str) -> dict[str, Settings]:
    """Read `further_experiments` from YAML and check it against the schema."""
    import yaml

    from deabayes.records.schema import violations

    try:
        entries = yaml.safe_load(asked) or {}
    except yaml.YAMLError:
        raise UserError(
            f"--asked {asked!r} is no YAML; write such as '{{longer: {{like: NAME, duration: 2}}}}'"
        ) from None
    study = {"specimen": "any", "candidates": ["any"], "further_experiments": entries}
    faults = violations({"studies": {"asked": study}}, "config", "--asked")
    if faults:
        raise Faults(faults)
    return dict(entries)


def check_as_fitted(results: Path) -> None:
    """Refuse results whose prepared records are not those that the posteriors were fitted to.

    Results without prepared records, such as those of a population, are not checked.

    Raises
    ------
    Faults : each record that was added, taken out or changed since, by candidate.
    """
    from deabayes.posteriors.records import check_fitted_records
    from deabayes.posteriors.storage import fitted_posteriors, read_tree

    posteriors, prepared = fitted_posteriors(results), results / "prepared"
    if not posteriors or not any(prepared.glob("*.nc")):
        return
    experiments, found = read_experiments(prepared), []
    for path in posteriors:
        try:
            check_fitted_records(read_tree(path, ("observed_data",)), experiments)
        except UserError as error:
            found += str(error).splitlines()
    if found:
        raise Faults(found)


ANALYSIS_DRAWS = 1000
"""The very draws that records are predicted with: a quantity has one value on the page."""


def analyse_study(results: Path, output: Path) -> list[str]:
    """Compute every analysis of a fitted study into `output`; return their names.

    Parameters
    ----------
    results : `results/{study}` with study.yaml, prepared records and posteriors.
    """
    from deabayes.papers import run_all
    from deabayes.papers.base import StudyContext
    from deabayes.studies import load_study

    check_as_fitted(results)
    study = load_study(results / "study.yaml")
    candidates = fitted_candidates(study, results)
    inherited = inherited_prior(study)
    context = StudyContext(
        study,
        next(iter(candidates.values())).specimen,
        read_experiments(results / "prepared"),
        candidates,
        inherited.prior if inherited else None,
    )
    return run_all(context, output)


def fitted_candidates(study: Study, results: Path) -> dict[str, Fitted]:
    """The candidates of a study that have a posterior, in the study's order."""
    from deabayes.posteriors.fitted import Fitted
    from deabayes.posteriors.storage import read_tree

    files = {name: results / name / "posterior.nc" for name in study.candidates}
    found = {
        name: Fitted.from_tree(read_tree(path, ("posterior",)), size=ANALYSIS_DRAWS, seed=1)
        for name, path in files.items()
        if path.is_file()
    }
    if not found:
        raise UserError(
            f"{results}: holds no fitted candidate (*/posterior.nc); "
            "run `snakemake --cores 2` or `deabayes fit` first"
        )
    return found
