"""A first fit of every candidate in seconds: the best fit and the curvature of the posterior.

A preview shows whether records, units and priors make sense before anybody waits for a fit. Its
intervals are those of a normal density (Laplace's method), and it says where they are rough.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deabayes.files import write_text_atomically
from deabayes.pipeline.fit import build_target, inherited_prior, seed_of
from deabayes.pipeline.prepare import read_experiments
from deabayes.study import Study

if TYPE_CHECKING:
    import pandas as pd

    from deabayes.experiment import Experiment, FloatArray
    from deabayes.inference.log_posterior import LogPosterior
    from deabayes.posteriors.fitted import Fitted
    from deabayes.prediction.bands import Samples
    from deabayes.sampling.laplace import Laplace

DRAWS = 1000
"""Draws from the normal density, from which the intervals are computed."""
ROUGH = 0.05
"""The intervals are called rough if the effective share of the draws is smaller."""
MOST_NAMED = 5
"""Most records that are named on the screen."""
FOLDER, INDEX = "preview", "index.json"
MARK = "preview: best fit, not sampled"
"""What every row of a preview's tables says of itself."""


@dataclass(frozen=True)
class Preview:
    """The best fit of one candidate.

    Attributes
    ----------
    parameters : one row per parameter and derived quantity, in SI.
    records : one row per record, with its error.
    doubts : sentences on what not to trust.
    """

    candidate: str
    parameters: pd.DataFrame
    records: pd.DataFrame
    doubts: Sequence[str]


def preview_study(study: Study, prepared: Path, output: Path) -> list[Preview]:
    """Find the best fit of every candidate, and write it into the folder `output`.

    The files are `summary.csv`, `errors.csv`, a figure of data and fit per candidate, and
    `index.json`, which says for each candidate what not to trust. If a candidate fails, `output`
    stays as it was.

    Parameters
    ----------
    prepared : folder of all prepared records of the study.

    Raises
    ------
    UserError : no start of a candidate has a response to the records.
    """
    import pandas as pd

    experiments = read_experiments(prepared)
    unfinished = output.with_name(f".{output.name}.tmp")
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir(parents=True)
    previews = [
        _preview(study, candidate, prepared, experiments, unfinished)
        for candidate in study.candidates
    ]
    tables = {
        "summary": [each.parameters for each in previews],
        "errors": [each.records for each in previews],
    }
    for name, parts in tables.items():
        table = pd.concat(parts, ignore_index=True).assign(status=MARK)
        table.to_csv(unfinished / f"{name}.csv", index=False)
    index = [{"candidate": p.candidate, "status": MARK, "doubts": [*p.doubts]} for p in previews]
    write_text_atomically(json.dumps(index, indent=1), unfinished / INDEX)
    shutil.rmtree(output, ignore_errors=True)
    unfinished.replace(output)
    return previews


def _preview(
    study: Study, candidate: str, prepared: Path, experiments: Sequence[Experiment], folder: Path
) -> Preview:
    """Preview one candidate, and draw its figure into `folder`."""
    import pandas as pd

    from deabayes.faults import UserError
    from deabayes.posteriors.problem import problem_of
    from deabayes.sampling.laplace import laplace
    from deabayes.sampling.problem import EveryDrawFailed

    target = build_target(study, candidate, prepared)
    rng = np.random.default_rng(seed_of(study, candidate, "preview"))
    try:
        found = laplace(problem_of(target), rng, DRAWS)
    except EveryDrawFailed:
        raise UserError(
            f"study {study.name}, {candidate}: no start of the preview has a response to the "
            "records; are the units of records, specimen and priors right?"
        ) from None
    fitted = _fitted(study, target, found.peak)
    samples = [fitted.sample(experiment, rng) for experiment in experiments]
    errors = [_error(*pair) for pair in zip(experiments, samples, strict=True)]
    _draw(study, fitted, experiments, samples, errors, folder)
    rows = {
        "candidate": candidate,
        "experiment": [e.name for e in experiments],
        "role": [e.role for e in experiments],
        "protocol": [e.protocol for e in experiments],
        "e_rms_percent": errors,
    }
    records = pd.DataFrame(rows).sort_values(["role", "protocol", "experiment"])
    return Preview(candidate, _summary(candidate, target, found), records, list(doubts(found)))


def _summary(candidate: str, target: LogPosterior, found: Laplace) -> pd.DataFrame:
    """Best fit and 90 % interval of every parameter and derived quantity."""
    import pandas as pd

    from deabayes.posteriors.file import quantities

    stated = target.system.stated()
    named = {p.name: (p.symbol, p.unit, kind_of(p.name, stated)) for p in target.prior.parameters}
    peak = target.prior.to_parameters(found.peak[None])
    derived = target.system.derived(target.draws(peak))
    named |= {name: (each.symbol, each.unit, "derived") for name, each in derived.items()}
    best = quantities(target, peak)
    draws = {name: values[:0] for name, values in best.items()}
    if len(found.draws):
        draws = quantities(target, target.prior.to_parameters(found.draws))
    rows = []
    for name, (symbol, unit, kind) in named.items():
        finite = draws[name][np.isfinite(draws[name])]
        low, high = np.quantile(finite, [0.05, 0.95]) if finite.size else (np.nan, np.nan)
        rows.append((candidate, name, symbol, kind, unit, float(best[name][0]), low, high))
    columns = ["candidate", "parameter", "symbol", "kind", "unit", "estimate", "q05", "q95"]
    return pd.DataFrame(rows, columns=columns)


def kind_of(name: str, stated: Container[str]) -> str:
    """Kind of a sampled parameter, as in posterior files: noise, specimen or material."""
    if "." in name:
        return "noise"
    return "specimen" if name in stated else "material"


def doubts(found: Laplace) -> Iterator[str]:
    """Yield a sentence on each reason not to trust a preview."""
    if found.agreed < 2:
        yield (
            f"no other of {found.climbs} starts reached the best fit"
            + (f"; the next is {found.next_lower:.1f} nats lower" if found.next_lower else "")
            + ". There may be a better one"
        )
    elif found.agreed < found.climbs:
        yield f"{found.climbs - found.agreed} of {found.climbs} starts ended at a worse fit"
    if found.not_curved:
        yield (
            f"the curvature is not positive definite: in {found.not_curved} of "
            f"{found.peak.size} directions the best fit is no clear peak, and the intervals "
            "are a guess there"
        )
    if not len(found.draws):
        yield "the model fails everywhere near the best fit, so there are no intervals"
    elif found.effective < ROUGH:
        yield "the posterior is not normal near the best fit, so the intervals are rough"


def _fitted(study: Study, target: LogPosterior, peak: FloatArray) -> Fitted:
    """Return a candidate with the best fit as its only draw.

    Parameters that only predictions need (`predict_with`) have the median of their prior.
    """
    from deabayes.inference.default_priors import further_prior, wider_systems
    from deabayes.posteriors.fitted import Fitted
    from deabayes.prediction.calibrated import CalibratedRecord

    system, inherited = target.system, inherited_prior(study)
    draws: dict[str, FloatArray] = dict(target.draws(target.prior.to_parameters(peak[None])))
    further = further_prior(study, system, target.names, inherited.prior if inherited else None)
    if further is not None:
        median = further.to_parameters(np.zeros((1, len(further.names))))
        draws |= dict(zip(further.names, median.T, strict=True))
    records = tuple(
        CalibratedRecord.of(r.experiment, r.group, r.scale, r.correlated_scale)
        for r in target.records
    )
    return Fitted(
        system.candidate,
        system.specimen,
        system,
        target.noise,
        study.noise_scale,
        study.noise_coordinate,
        draws,
        records,
        converged=False,
        predicts_with=wider_systems(study, system),
    )


def _error(experiment: Experiment, samples: Samples) -> float:
    """Root mean square error in per cent of the record's range; NaN for a constant record."""
    from deabayes.prediction.errors import relative_rms_error

    if np.ptp(experiment.response) == 0.0:
        return float("nan")
    return 100.0 * float(relative_rms_error(experiment.response, samples.parameter[0]))


def _draw(
    study: Study,
    fitted: Fitted,
    experiments: Sequence[Experiment],
    samples: Sequence[Samples],
    errors: Sequence[float],
    folder: Path,
) -> None:
    """Write the figure of data and fit, `{candidate}[_{sheet}]`.svg, .png and .pdf."""
    from deabayes.figures import preview, style
    from deabayes.prediction.bands import to_dataset

    predictions = []
    for experiment, sampled, error in zip(experiments, samples, errors, strict=True):
        said: Mapping[str, object] = {
            preview.E_RMS: error,
            "extrapolation": fitted.extrapolation(experiment),
        }
        predictions.append(to_dataset(experiment, sampled, said))
    predictions.sort(key=lambda p: [p.attrs[key] for key in ("role", "protocol", "experiment")])
    sheets = preview.draw(predictions, f"{study.name}  ·  {fitted.candidate}")
    for number, figure in enumerate(sheets, start=1):
        stem = f"{fitted.candidate}_{number}" if len(sheets) > 1 else fitted.candidate
        with style.applied():
            names = [study.name, fitted.candidate]
            style.write(figure, folder / stem, ", ".join(["Preview", *names]), names)


def in_words(study: Study, previews: Sequence[Preview], output: Path) -> list[str]:
    """Short table of a preview for the screen: parameters, errors, and what not to trust."""
    from deabayes.quantities import display_unit

    lines = [
        f"PREVIEW of study {study.name}: best fits, not sampled. Figures in {output}",
        "Intervals are from the curvature there; sampled ones may be several times wider.",
    ]
    for each in previews:
        lines += ["", f"{each.candidate}: estimate (5 % to 95 %)"]
        shown = each.parameters[each.parameters["kind"].isin(["material", "specimen"])]
        for row in shown.itertuples():
            unit = display_unit(row.unit, row.estimate, row.parameter)
            best, low, high = (x / unit.factor for x in (row.estimate, row.q05, row.q95))
            interval = f"({low:.4g} to {high:.4g})" if np.isfinite(low) else "(not known)"
            line = f"  {row.parameter:24} {best:10.4g} {interval} {unit.label}"
            lines.append(line.rstrip())
        worst = each.records.nlargest(MOST_NAMED, "e_rms_percent")
        said = [f"{r.experiment} {r.e_rms_percent:.2g} %" for r in worst.itertuples()]
        lines.append(f"  largest errors (e_rms): {', '.join(said)}")
        lines += [f"  Note: {doubt}." for doubt in each.doubts]
    return lines
