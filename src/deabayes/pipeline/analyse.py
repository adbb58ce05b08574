"""From posteriors to what a paper of the system reports."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from deabayes.faults import UserError
from deabayes.pipeline.as_fitted import check_as_fitted
from deabayes.pipeline.identify import inherited_prior
from deabayes.pipeline.prepare import read_experiments

if TYPE_CHECKING:
    from deabayes.fitted import Fitted
    from deabayes.study import Study

ANALYSIS_DRAWS = 1000
"""The very draws that records are predicted with: a quantity has one value on the page."""


def analyse_study(results: Path, output: Path) -> list[str]:
    """Compute every analysis of a fitted study's system into `output`; their names.

    Parameters
    ----------
    results : `results/{study}` with study.yaml, prepared records and posteriors.
    """
    from deabayes.analyses import run_all
    from deabayes.analyses.base import StudyContext
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
    from deabayes.fitted import Fitted
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
