"""The sampler on posteriors that cover what it meets: what it costs, and how far it is off.

    python -m benchmarks.sampler_suite                         every posterior against its reference
    python -m benchmarks.sampler_suite --only membrane         those whose name holds a word
    python -m benchmarks.sampler_suite --reference OLD         take references from results of other
                                                               code, such as an earlier commit
    python -m benchmarks.sampler_suite --without hops --output docs/benchmarks/sampler_ablation.csv
                                                               leave a part out: what is it worth?

Posteriors are the candidates of `config.yaml` and of the extended profile, with the prepared
records in `results/` (run `snakemake --cores 2` first), and simulated specimens of the validation:
a unit too many, a unit that is hardly seen, terms that share a stress. References are in
`sampler_references.csv`: means, standard deviations, 5 and 95 % ends of every parameter, and the
log evidence, of long runs. Of a simulated specimen there is a reference only where one was made
(`--long`).
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
from tests.validation import membrane_worlds, structure_worlds, tubular_worlds
from tests.validation.worlds import World, simulate

from deabayes.comparison.evidence import bridge_evidence
from deabayes.inference.log_posterior import LogPosterior
from deabayes.pipeline import build_target
from deabayes.posteriors.problem import problem_of
from deabayes.sampling.engine import Sampled, sample
from deabayes.sampling.problem import Coordinates, Problem
from deabayes.studies import load_studies
from deabayes.study import Sampling

RESULTS, REFERENCES = Path("results"), Path(__file__).with_name("sampler_references.csv")
LONG = Sampling(autocorrelation_times=50.0, max_steps=100000)
SEED = 20261128
COLUMNS = ("parameter", "mean", "sd", "q05", "q95")
WORLDS: Mapping[str, tuple[Callable[[], World], int, int]] = {
    "tube of 1 unit with 2": (tubular_worlds.tubular, 1, 2),
    "tube of 2 units with 3": (tubular_worlds.tubular, 2, 3),
    "membrane of 1 unit with 2": (membrane_worlds.membrane, 1, 2),
    "membrane of 2 units with 3": (membrane_worlds.membrane, 2, 3),
    "membrane of 3 units": (membrane_worlds.membrane, 3, 3),
    "forces of 1 term with 2": (structure_worlds.at_rest, 1, 2),
}
"""World, order of the truth, order that is fitted."""
FILES = (Path("config.yaml"), Path("workflow/profiles/extended/studies.yaml"))
SPECIMENS = 3
PARTS: Mapping[str, Callable[[Problem], Problem]] = {
    "hops": lambda problem: replace(problem, hops=()),
    "coordinates": lambda problem: replace(problem, coordinates=Coordinates()),
    "rough": lambda problem: replace(problem, rough=None),
    "points": lambda problem: replace(problem, split=None, rough=None),
}
"""Parts of a problem, by what is left of it without."""
CONSTANTS: Mapping[str, Mapping[str, float]] = {
    "covering": {"proposal.COVERING": 1e-9},
    "map": {"proposal.STRAIGHTENED": 1e-9, "proposal.PLAIN": 1.0},
    "waves": {"peaks.MOST_WAVES": 1},
    "walks": {"warm_up.MOST_STEPS": 0},
    "further draws": {"engine.AIM": 0.0},
}
"""Parts of the sampler, by the constants that leave them out."""


@dataclass(frozen=True)
class Case:
    """A posterior by name, built when it is its turn."""

    name: str
    build: Callable[[], LogPosterior]


def cases() -> Iterator[Case]:
    """The candidates of `FILES` whose records are prepared, then the simulated specimens."""
    for study in (study for file in FILES for study in load_studies(file)):
        prepared = RESULTS / study.name / "prepared"
        if prepared.is_dir():
            for candidate in study.candidates:
                yield Case(
                    f"{study.name}/{candidate}", partial(build_target, study, candidate, prepared)
                )
    for index, (name, (world, truth, fitted)) in enumerate(WORLDS.items()):
        for number in range(1, SPECIMENS + 1):
            stream = np.random.SeedSequence([SEED, index, number])
            posterior = partial(_simulated, world, truth, fitted, stream)
            yield Case(f"{name} #{number}", posterior)


def _simulated(
    build: Callable[[], World], truth: int, fitted: int, stream: np.random.SeedSequence
) -> LogPosterior:
    world = build()
    target = world.target(truth)
    records = simulate(world, target, np.random.default_rng(stream)).records
    return world.conditioned(fitted, records)


def run(
    case: Case, settings: Sampling, seed: int, without: str = ""
) -> tuple[dict[str, object], pd.DataFrame]:
    """Sample one posterior: what it cost, and the summary of its parameters."""
    target = case.build()
    problem = problem_of(target)
    problem = PARTS.get(without, lambda problem: problem)(problem)
    problem.log_likelihood(np.zeros((2, target.dimension)))  # compiled before the clock starts
    began = time.process_time()
    with ExitStack() as changed:
        for name, value in CONSTANTS.get(without, {}).items():
            changed.enter_context(patch(f"deabayes.sampling.{name}", value))
        found = sample(problem, settings, np.random.SeedSequence([SEED, seed]))
    seconds = time.process_time() - began
    table = found.convergence.table.loc[list(target.names)]
    cost: dict[str, object] = {
        "without": without,
        "seed": seed,
        "posterior": case.name,
        "parameters": target.dimension,
        "evaluations": found.evaluations,
        "cpu_seconds": round(seconds, 1),
        "rounds": found.rounds,
        "r_hat": round(float(table["r_hat"].max()), 4),
        "smallest_ess": round(float(table[["ess_bulk", "ess_tail"]].min().min())),
        "converged": found.convergence.converged,
        "log_evidence": round(_evidence(target, found), 2),
    }
    return cost, table


def _evidence(target: LogPosterior, found: Sampled) -> float:
    z, _ = found.thinned(2000)
    effective = float(found.convergence.table["ess_bulk"].min()) / len(z)
    return bridge_evidence(target, z, effective, np.random.SeedSequence(SEED)).log_evidence


def distances(table: pd.DataFrame, evidence: float, reference: pd.DataFrame) -> dict[str, float]:
    """How far from the reference, in its standard deviations; evidence in nats."""
    known = reference.set_index("parameter").reindex(table.index)
    sd = known["sd"]
    return {
        "mean": float(((table["mean"] - known["mean"]).abs() / sd).max()),
        "sd": float(np.log(table["sd"] / sd).abs().max()),
        "ends": float(max(((table[end] - known[end]).abs() / sd).max() for end in ("q05", "q95"))),
        "evidence": abs(evidence - float(reference["log_evidence"].iloc[0])),
    }


def from_results(folder: Path) -> pd.DataFrame:
    """References from summary.csv and scores.json of fitted candidates, whatever code made them."""
    rows = []
    for path in sorted(folder.glob("*/*/summary.csv")):
        table = pd.read_csv(path)[list(COLUMNS)]
        scores = path.with_name("scores.json")
        evidence = json.loads(scores.read_text())["log_evidence"] if scores.is_file() else np.nan
        name = f"{path.parts[-3]}/{path.parts[-2]}"
        rows.append(table.assign(posterior=name, log_evidence=evidence))
    return pd.concat(rows, ignore_index=True).assign(source=str(folder))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", default="", help="posteriors whose name holds this")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--without", default="", choices=[*PARTS, *CONSTANTS])
    parser.add_argument("--output", type=Path, help="table to add the rows to")
    parser.add_argument("--long", action="store_true", help="run long, and keep as references")
    parser.add_argument("--reference", type=Path, help="keep results of this folder as references")
    given = parser.parse_args()
    if given.reference:
        _keep(from_results(given.reference))
        return
    references = pd.read_csv(REFERENCES) if REFERENCES.is_file() else pd.DataFrame()
    settings = LONG if given.long else Sampling()
    total = 0.0
    for case in cases():
        if given.only not in case.name:
            continue
        cost, table = run(case, settings, given.seed, given.without)
        total += float(str(cost["cpu_seconds"]))
        if given.long:
            kept = table.rename_axis("parameter").reset_index()[list(COLUMNS)]
            _keep(
                kept.assign(
                    posterior=case.name, log_evidence=cost["log_evidence"], source="long run"
                )
            )
        elif len(references) and (known := references[references["posterior"] == case.name]).size:
            off = distances(table, float(str(cost["log_evidence"])), known)
            cost |= {f"off_{name}": round(value, 3) for name, value in off.items()}
        print(json.dumps(cost), flush=True)
        if given.output:
            there = [pd.read_csv(given.output)] if given.output.is_file() else []
            pd.concat([*there, pd.DataFrame([cost])]).to_csv(given.output, index=False)
    print(f"{total:.0f} CPU s in all")


def _keep(new: pd.DataFrame) -> None:
    """Put references in the file, in place of older ones of the same posteriors."""
    old = pd.read_csv(REFERENCES) if REFERENCES.is_file() else new.iloc[:0]
    kept = old[~old["posterior"].isin(new["posterior"])]
    table = pd.concat([kept, new], ignore_index=True)
    table.to_csv(REFERENCES, index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
