"""Results that are shown together: posteriors, and the records that they were fitted to."""

from __future__ import annotations

from pathlib import Path

from deabayes.faults import Faults, UserError
from deabayes.pipeline.prepare import read_experiments


def check_as_fitted(results: Path) -> None:
    """Refuse a study's results whose prepared records are no longer those of its posteriors.

    Results without prepared records, a population's among them, are passed over.

    Raises
    ------
    Faults : each record that was added, taken out or changed since, by candidate.
    """
    from deabayes.posteriors.fitted_records import check_fitted_records
    from deabayes.posteriors.found import fitted_posteriors
    from deabayes.posteriors.storage import read_tree

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
