"""From prepared records to a posterior."""

from __future__ import annotations

import hashlib
import json
import shutil
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deabayes.faults import UserError
from deabayes.pipeline.prepare import calibrated_files, read_experiments
from deabayes.pipeline.sources import digest_of
from deabayes.records.preparation.prepared import read_prepared
from deabayes.study import Study, fit_settings

if TYPE_CHECKING:
    import xarray as xr

    from deabayes.experiment import Specimen
    from deabayes.inference.log_posterior import LogPosterior
    from deabayes.posteriors.content import PosteriorContent
    from deabayes.posteriors.inheritance import Inheritance
    from deabayes.sampling.engine import Sampled


DRAWS_TO_TELL = 200
"""Of the prior, where none has a response: to which records?"""


def seed_of(study: Study, candidate: str, stage: str, index: int = 0) -> np.random.SeedSequence:
    """Seed of the random numbers of one stage of one candidate."""
    words = [zlib.crc32(text.encode()) for text in (study.name, candidate, stage)]
    return np.random.SeedSequence([study.sampling.seed, *words, index])


def fit_candidate(
    study: Study, candidate: str, prepared: Path, output: Path, summary: Path, progress: bool
) -> None:
    """Sample the posterior of a candidate, and write posterior.nc and summary.csv.

    After an interruption, the same call continues from the checkpoints beside `output`. They are
    removed once both files are written.

    Raises
    ------
    UserError : no draw of the prior has a response to the records.
    """
    from deabayes.files import write_atomically
    from deabayes.posteriors.file import posterior_tree
    from deabayes.posteriors.storage import write_tree

    target = build_target(study, candidate, prepared)
    folder = chain_folder(study, candidate, prepared, output.parent)
    sampled = _sampled(study, candidate, target, folder, progress)
    tree = posterior_tree(_content(study, candidate, target, sampled))
    table = tree["summary"].to_dataset().to_dataframe().rename_axis("parameter")
    write_tree(tree, output)
    write_atomically(lambda path: table.to_csv(path), summary)
    shutil.rmtree(output.parent / ".chain", ignore_errors=True)


def _sampled(
    study: Study, candidate: str, target: LogPosterior, folder: Path, progress: bool
) -> Sampled:
    from deabayes.posteriors.problem import problem_of
    from deabayes.sampling.engine import sample
    from deabayes.sampling.problem import EveryDrawFailed
    from deabayes.sampling.progress import Progress

    seed = seed_of(study, candidate, "fit")
    try:
        return sample(problem_of(target), study.sampling, seed, folder, Progress(progress))
    except EveryDrawFailed:
        raise UserError(f"study {study.name}, {candidate}: {_without_response(target)}; are the "
                        "units of records, specimen and priors right?") from None  # fmt: skip


def _without_response(target: LogPosterior) -> str:
    """Name the records to which no draw of the prior has a response."""
    theta = target.prior.sample(np.random.default_rng(0), DRAWS_TO_TELL)
    names = [record.experiment.name for record in target.records]
    lost = [name for name in names if not np.isfinite(target.log_likelihood(theta, [name])).any()]
    return f"no draw of the prior has a response to {', '.join(lost) or 'all records at once'}"


def _content(
    study: Study, candidate: str, target: LogPosterior, sampled: Sampled
) -> PosteriorContent:
    from deabayes.checks.priors import overruled, unexpected
    from deabayes.inference.default_priors import further_prior
    from deabayes.posteriors.content import PosteriorContent

    inherited = inherited_prior(study)
    if inherited is not None:
        said = overruled(study, target.system, inherited.prior.names, inherited.priors)
        inherited = replace(inherited, notes=(*inherited.notes, *said))
    further = further_prior(
        study, target.system, target.names, inherited.prior if inherited else None
    )
    seed = seed_of(study, candidate, "prior")
    odd = unexpected(study, target.system, [record.experiment for record in target.records])
    return PosteriorContent.of(study, candidate, target, sampled, seed, further, inherited, odd)


def build_target(study: Study, candidate: str, prepared: Path) -> LogPosterior:
    """The log-posterior of a candidate over a study's calibration records."""
    from deabayes.records.specimen import read_specimen

    return _target(study, candidate, read_specimen(study.specimen), prepared)


def _target(study: Study, candidate: str, specimen: Specimen, prepared: Path) -> LogPosterior:
    from deabayes.inference.log_posterior import build
    from deabayes.posteriors.records import refuse_counted_twice

    experiments = [read_prepared(path) for path in calibrated_files(study, prepared)]
    inherited = inherited_prior(study, specimen)
    if inherited is None:
        return build(study, candidate, specimen, experiments)
    refuse_counted_twice(study.name, experiments, inherited.counted, str(study.prior_from))
    return build(study, candidate, specimen, experiments, inherited.prior, inherited.same_specimen)


def stored_target(tree: xr.DataTree, prepared: Path) -> tuple[Study, LogPosterior]:
    """Study and log-posterior of a posterior file.

    Specimen and prior are read from the file. The study's folder and the posterior that
    `prior_from` names may have moved or changed since.

    Raises
    ------
    UserError : a file from before they held their prior, and that of `prior_from` is gone;
        calibrated records that are not those of the fit.
    """
    from deabayes.inference.log_posterior import build
    from deabayes.own_models.loading import restore
    from deabayes.posteriors.inheritance import GROUP, with_inherited_prior
    from deabayes.posteriors.records import check_fitted_records
    from deabayes.posteriors.storage import specimen_from_json
    from deabayes.study import from_settings

    restore(tree.attrs)
    study = from_settings(json.loads(tree.attrs["study"]))
    candidate, specimen = tree.attrs["candidate"], specimen_from_json(tree.attrs["specimen"])
    experiments = read_experiments(prepared)
    check_fitted_records(tree, experiments)
    if study.prior_from is None or GROUP in tree.children:
        target = build(study, candidate, specimen, experiments)
        return study, with_inherited_prior(target, tree)
    if not Path(study.prior_from).is_file():
        raise UserError(
            f"study {study.name}, {candidate}: its posterior file is of an earlier version and "
            f"does not hold the prior that it has from {study.prior_from}, which is not there "
            "either; put that file back, or fit the candidate again"
        )
    return study, _target(study, candidate, specimen, prepared)


def inherited_prior(study: Study, specimen: Specimen | None = None) -> Inheritance | None:
    """Read the posterior that `prior_from` names, as a prior for this specimen."""
    from deabayes.posteriors.inheritance import inherit_from
    from deabayes.records.specimen import read_specimen

    if study.prior_from is None:
        return None
    return inherit_from(Path(study.prior_from), specimen or read_specimen(study.specimen))


def chain_folder(study: Study, candidate: str, prepared: Path, results: Path) -> Path:
    """Folder of a candidate's checkpoints.

    Its name is a hash of everything the draws depend on, so that old checkpoints are never
    resumed.
    """
    digest = hashlib.sha256(candidate.encode())
    for part in _what_draws_follow_from(study, prepared):
        digest.update(hashlib.sha256(part).digest())
    return results / ".chain" / digest.hexdigest()[:16]


def _what_draws_follow_from(study: Study, prepared: Path) -> Iterator[bytes]:
    """Everything the draws depend on: settings, specimen, fitted records, prior, code."""
    from deabayes.posteriors.storage import specimen_to_json
    from deabayes.records.specimen import read_specimen

    yield json.dumps(fit_settings(study), sort_keys=True, default=str).encode()
    yield specimen_to_json(read_specimen(study.specimen)).encode()
    yield digest_of("pipeline.fit").encode()
    given = [Path(path) for path in (study.model, study.prior_from) if path is not None]
    for path in [*calibrated_files(study, prepared), *given]:
        yield path.name.encode()
        yield path.read_bytes()
