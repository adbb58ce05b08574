"""Compute the rows of comparison.csv from posterior files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from deabayes.comparison.blocks import BlockLoo, block_ends, leave_one_block_out
from deabayes.comparison.decision import Decision, Score, decide
from deabayes.comparison.evidence import leave_one_experiment_out
from deabayes.comparison.left_out import leave_blocks_out
from deabayes.comparison.verdicts import elpd_difference, ends_difference, verdicts
from deabayes.experiment import FloatArray
from deabayes.inference.blocks import (
    FEWEST_BLOCKS,
    Edges,
    block_edges,
    block_log_likelihood,
    block_names,
    block_places,
)
from deabayes.inference.log_posterior import LogPosterior
from deabayes.posteriors.problem import problem_of
from deabayes.posteriors.storage import stacked
from deabayes.quantities import with_unit

LOO_DRAWS = 4000
TRUSTED_K_HAT = 0.5
"""Largest Pareto shape at which a block's importance weights are trusted. With 0.7 (1000 draws),
one in four of the blocks that nearly alone inform a parameter passed, with a log density 1 to 3
nats too high (docs/statistics.md)."""
SAMPLED_DRAWS = 128
"""Number of draws for leaving a block out by sampling, if its importance weights are unreliable."""
FAR_BEHIND = 50.0
"""Nats of log evidence and of elpd. A candidate further behind the best in both is not sampled
without blocks or experiments: that changes a few nats only."""
CORRELATION_TIMES_PER_BLOCK = 2.0


@dataclass(frozen=True)
class Ranked:
    """A candidate's posterior file with its log-posterior and its scores (scores.json)."""

    tree: xr.DataTree
    target: LogPosterior
    scores: Mapping[str, float]

    @property
    def candidate(self) -> str:
        return str(self.tree.attrs["candidate"])

    @property
    def converged(self) -> bool:
        return bool(json.loads(self.tree.attrs["convergence"])["converged"])

    def theta(self, size: int) -> FloatArray:
        """`size` draws (size, d) spread evenly over all ensembles."""
        columns = [stacked(self.tree["posterior"], name) for name in self.target.names]
        draws = np.stack(columns, axis=1)
        return draws[np.linspace(0, len(draws) - 1, min(size, len(draws))).astype(int)]


def common_blocks(ranked: Sequence[Ranked]) -> dict[str, NDArray[np.intp]]:
    """First indices of the blocks of every calibrated record, the same for all candidates.

    A block is two correlation times long. The correlation time is the longest posterior median
    among the ranked candidates. A record has about `FEWEST_BLOCKS` blocks or more, so that a
    candidate whose noise fits the whole curve does not reduce the record to one block. With a
    noise model without correlation, a block has three points.
    """
    edges = {}
    for record in ranked[0].target.records:
        lengths = [
            float(np.median(stacked(r.tree["posterior"], name)))
            for r in ranked
            for name in r.target.names
            if name == f"{record.group}.{r.target.noise.length}"
        ]
        coordinate = record.noise_coordinate
        steps = np.diff(coordinate)
        spacing = 3.0 * float(np.median(steps[steps > 0.0]))
        length = CORRELATION_TIMES_PER_BLOCK * max(lengths) if lengths else spacing
        longest = float(np.ptp(coordinate)) / FEWEST_BLOCKS
        edges[record.experiment.name] = block_edges(coordinate, min(length, longest))
    return edges


def block_loo(ranked: Ranked, edges: Edges) -> BlockLoo:
    """Compute the block-LOO of one candidate over all calibrated records by importance weights."""
    target = ranked.target
    theta = ranked.theta(LOO_DRAWS)
    terms = block_log_likelihood(target, theta, edges)
    experiments = {r.experiment.name: r.experiment for r in target.records}
    places = block_places(target, edges)
    names, ends = block_names(experiments, places), block_ends(experiments, places)
    return leave_one_block_out(terms, names, ends)


def _sampled(ranked: Ranked, loo: BlockLoo, edges: Edges, seed: np.random.SeedSequence) -> BlockLoo:
    """Replace the terms of blocks whose importance weights are not trusted, by sampling."""
    doubtful = np.flatnonzero(~(loo.k_hat <= TRUSTED_K_HAT))
    if not doubtful.size:
        return loo
    target, terms = ranked.target, loo.terms.copy()
    z = target.prior.to_normal(ranked.theta(SAMPLED_DRAWS))
    places = block_places(target, edges)
    blocks = [places[block] for block in doubtful]
    terms[doubtful] = leave_blocks_out(target, problem_of(target), blocks, z, seed)
    return replace(loo, terms=terms)


def score_all(candidates: Sequence[Ranked], seed: np.random.SeedSequence) -> list[Score]:
    """Score all candidates by what decides; only converged ones get a block-LOO."""
    converged = [c for c in candidates if c.converged]
    edges = common_blocks(converged) if converged else {}
    scores = [_score(c, block_loo(c, edges) if c.converged else None) for c in candidates]
    close = close_calls(scores)
    streams = seed.spawn(len(candidates))
    return [
        replace(s, loo=_sampled(c, s.loo, edges, stream)) if s.loo and s.candidate in close else s
        for s, c, stream in zip(scores, candidates, streams, strict=True)
    ]


def _score(ranked: Ranked, loo: BlockLoo | None) -> Score:
    scores, unknown = ranked.scores, float("nan")
    return Score(
        candidate=ranked.candidate,
        order=int(ranked.tree.attrs["order"]),
        n_parameters=ranked.target.dimension,
        converged=ranked.converged,
        log_evidence=scores["log_evidence"],
        log_evidence_mcse=scores["log_evidence_mcse"],
        bic=scores["bic"],
        loo=loo,
        log_evidence_nested=scores.get("log_evidence_nested", unknown),
        log_evidence_nested_error=scores.get("log_evidence_nested_error", unknown),
    )


def close_calls(scores: Sequence[Score]) -> list[str]:
    """List the candidates that are not far behind the best; empty if there are fewer than two."""
    known = [(s.candidate, s.log_evidence, s.loo.elpd) for s in scores if s.loo]
    evidence = max((own for _, own, _ in known), default=0.0) - FAR_BEHIND
    elpd = max((left for _, _, left in known), default=0.0) - FAR_BEHIND
    close = [name for name, own, left in known if not (own < evidence and left < elpd)]
    return close if len(close) > 1 else []


def _without_experiments(ranked: Ranked, score: Score, seed: np.random.SeedSequence) -> Score:
    """Add the score with every experiment left out; NaN stays if there is only one."""
    z = ranked.tree["unconstrained_posterior"]["z"].values
    draws = z.reshape(-1, z.shape[2])
    gains = leave_one_experiment_out(ranked.target, score.log_evidence, draws, seed)
    return replace(score, leave_one_experiment_out=sum(gains.values())) if gains else score


def comparison_table(candidates: Sequence[Ranked], seed: np.random.SeedSequence) -> pd.DataFrame:
    """Return the table of comparison.csv."""
    scores = score_all(candidates, seed)
    close, streams = close_calls(scores), seed.spawn(len(scores))
    scores = [
        _without_experiments(c, s, stream) if s.candidate in close else s
        for s, c, stream in zip(scores, candidates, streams, strict=True)
    ]
    decision = decide(scores)
    words = verdicts(scores, decision)
    chosen = next((s for s in scores if s.candidate == decision.chosen), None)
    rows = []
    for score, candidate in zip(scores, candidates, strict=True):
        unresolved = score.candidate in decision.unresolved
        rows.append(
            _row(score, chosen)
            | {
                "verdict": words[score.candidate],
                "differs_in": _difference(candidate, candidates, decision) if unresolved else "",
                "log_evidence_nested": score.log_evidence_nested,
                "log_evidence_nested_error": score.log_evidence_nested_error,
            }
        )
    return pd.DataFrame(rows)


def _row(score: Score, chosen: Score | None) -> dict[str, object]:
    """Return the scores of a candidate, and their difference from the chosen one's."""
    unknown = float("nan")
    loo, difference, at_ends = score.loo, (unknown, unknown), unknown
    if chosen is not None and loo is not None:
        difference = elpd_difference(score, chosen)
        at_ends = ends_difference(score, chosen)
    return {
        "candidate": score.candidate,
        "order": score.order,
        "n_parameters": score.n_parameters,
        "log_evidence": score.log_evidence,
        "log_evidence_mcse": score.log_evidence_mcse,
        "bic": score.bic,
        "elpd_block_loo": loo.elpd if loo else unknown,
        "elpd_block_loo_se": loo.se if loo else unknown,
        "elpd_difference": difference[0],
        "elpd_difference_se": difference[1],
        "elpd_difference_ends": at_ends,
        "elpd_leave_one_experiment_out": score.leave_one_experiment_out,
        "worst_k_hat": float(loo.k_hat.max()) if loo else unknown,
        "converged": score.converged,
    }


def _difference(one: Ranked, candidates: Sequence[Ranked], decision: Decision) -> str:
    """Say where the median curves of an unresolved candidate and the chosen one differ most."""
    chosen = next(c for c in candidates if c.candidate == decision.chosen)
    mine, theirs = (
        {name: np.nanmedian(f, axis=0) for name, f in c.target.responses(c.theta(200)).items()}
        for c in (one, chosen)
    )
    gaps = {
        r.experiment.name: np.abs(mine[r.experiment.name] - theirs[r.experiment.name])
        / r.experiment.response_range
        for r in one.target.records
    }
    name = max(gaps, key=lambda key: float(gaps[key].max()))
    record = next(r for r in one.target.records if r.experiment.name == name)
    at = float(record.experiment.coordinate[int(gaps[name].argmax())])
    coordinate, unit = record.experiment.coordinate_name, record.experiment.coordinate_unit
    return (
        f"median curves differ from {chosen.candidate} by at most "
        f"{100 * gaps[name].max():.2g} % of the range, in {name} at {coordinate} "
        f"{with_unit(at, unit, coordinate, 3)}"
    )
