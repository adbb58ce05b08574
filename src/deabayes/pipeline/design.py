"""From posteriors to which experiment to do next."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from deabayes.faults import Faults, UserError
from deabayes.files import write_atomically
from deabayes.pipeline.identify import seed_of
from deabayes.pipeline.prepare import read_experiments
from deabayes.study import Settings, from_settings

DRAWS = 500


def further_experiments(results: Path, asked: Mapping[str, Settings], output: Path) -> None:
    """Weigh held-out records and experiments asked for; write further_experiments.csv.

    Parameters
    ----------
    results : `results/{study}` with prepared records, posteriors and the comparison.
    asked : `further_experiments` of the study.
    """
    import pandas as pd

    from deabayes.fitted import Fitted
    from deabayes.further.planned import plan
    from deabayes.further.table import contenders, further_table
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
    """`further_experiments` from YAML, held against the schema of a config."""
    import yaml

    from deabayes.reading.schema import violations

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
