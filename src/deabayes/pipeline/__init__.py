"""The stages from raw records to a report, one function each.

The command line and the workflow's rules call these; each reads files, calls
the layers below and writes files, nothing else.
"""

from deabayes.pipeline.fit import build_target, fit_candidate, seed_of
from deabayes.pipeline.judge import (
    analyse_study,
    check_evidence,
    compare_candidates,
    entries_of,
    further_experiments,
    predict_candidate,
    score_candidate,
)
from deabayes.pipeline.prepare import (
    prepare_record,
    prepare_study,
    read_experiments,
    select_rows,
)
from deabayes.pipeline.publish import build_report, draw_figures, export_posterior, fit_population

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
    "fit_population",
    "further_experiments",
    "predict_candidate",
    "prepare_record",
    "prepare_study",
    "read_experiments",
    "score_candidate",
    "seed_of",
    "select_rows",
]
