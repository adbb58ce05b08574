"""The line from raw records to a report, one function per stage.

The command line and the workflow's rules call these; each reads files, calls
the layers below and writes files, nothing else.
"""

from deabayes.pipeline.analyse import analyse_study
from deabayes.pipeline.design import entries_of, further_experiments
from deabayes.pipeline.identify import build_target, fit_candidate, seed_of
from deabayes.pipeline.judge import (
    check_evidence,
    compare_candidates,
    predict_candidate,
    score_candidate,
)
from deabayes.pipeline.made_of import fit_made_of, sums
from deabayes.pipeline.population import fit_population
from deabayes.pipeline.prepare import prepare_study, read_experiments, select_rows
from deabayes.pipeline.publish import build_report, draw_figures, export_posterior

__all__ = [
    "analyse_study",
    "build_report",
    "build_target",
    "check_evidence",
    "compare_candidates",
    "draw_figures",
    "entries_of",
    "export_posterior",
    "fit_candidate",
    "fit_made_of",
    "fit_population",
    "further_experiments",
    "predict_candidate",
    "prepare_study",
    "read_experiments",
    "score_candidate",
    "seed_of",
    "select_rows",
    "sums",
]
