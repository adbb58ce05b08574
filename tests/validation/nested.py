"""The pooled emcee posterior and its bridge evidence against nested sampling.

Case A of mixing.md (`cases`) with three units, 14 parameters, in z: the prior of every
coordinate is standard normal, so dynesty's prior transform is the normal quantile. emcee runs
as in a study by default. Written: nested_evidence.csv, one row per case
and seed, and nested_parameters.csv, one row per case, seed and parameter, with the differences
in posterior standard deviations.

    python -m tests.validation.nested --case A --live 500
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from deabayes.comparison.evidence import bridge_evidence
from deabayes.comparison.nested import LIVE, nested
from deabayes.experiment import FloatArray
from tests.validation import rows
from tests.validation.cases import RELAXATION_TIMES, case
from tests.validation.sampled import Sampled, sample

SEED = 20261125
EVIDENCE, PARAMETERS = "nested_evidence.csv", "nested_parameters.csv"


def evidence_row(sampled: Sampled, results: Any, seed: np.random.SeedSequence) -> rows.Row:
    """Both estimates of the evidence, and how the two runs went."""
    z = sampled.z
    effective = float(sampled.result.convergence.table["ess_bulk"].min()) / len(z)
    bridge = bridge_evidence(sampled.target, z, effective, seed)
    return {
        "bridge": f"{bridge.log_evidence:.3f}",
        "bridge_mcse": f"{bridge.mcse:.3f}",
        "nested": f"{results.logz[-1]:.3f}",
        "nested_error": f"{results.logzerr[-1]:.3f}",
        "difference": f"{bridge.log_evidence - results.logz[-1]:.3f}",
        "nested_calls": int(np.sum(results.ncall)),
        **sampled.row(),
    }


def parameter_rows(
    names: tuple[str, ...], ours: FloatArray, theirs: FloatArray, size: float
) -> list[rows.Row]:
    """Differences, emcee minus nested, in nested posterior sds, of the logarithms.

    Parameters
    ----------
    ours, theirs : draws (S, d), SI.
    size : effective number of nested draws, for the error of their mean.
    """
    result: list[rows.Row] = []
    for name, one, other in zip(names, np.log(ours).T, np.log(theirs).T, strict=True):
        spread = other.std()
        low, high = (np.quantile(one, [0.05, 0.95]) - np.quantile(other, [0.05, 0.95])) / spread
        result.append(
            {
                "parameter": name,
                "mean_difference_sd": f"{(one.mean() - other.mean()) / spread:.4f}",
                "standard_error_sd": f"{size**-0.5:.4f}",
                "sd_ratio": f"{one.std() / spread:.4f}",
                "q05_difference_sd": f"{low:.4f}",
                "q95_difference_sd": f"{high:.4f}",
            }
        )
    return result


def compare(name: str, live: int, output: Path) -> None:
    """Sample one case with both and append the rows of both tables."""
    target = case(name)
    emcee_seed, nested_seed, bridge_seed = np.random.SeedSequence([SEED, *name.encode()]).spawn(3)
    results, cpu = nested(target.log_likelihood_of_normal, target.dimension, nested_seed, live)
    weights = results.importance_weights()
    size = 1.0 / float(np.sum(weights**2))
    theirs = target.prior.to_parameters(results.samples_equal(np.random.default_rng(nested_seed)))
    sampled = sample(target, emcee_seed)
    task: rows.Task = {"case": name, "live": live}
    row = evidence_row(sampled, results, bridge_seed)
    row |= {"nested_ess": f"{size:.0f}", "nested_cpu_seconds": f"{cpu:.1f}"}
    rows.write(output / EVIDENCE, {**task, **row, **rows.provenance(SEED)})
    for parameter in parameter_rows(target.names, sampled.theta, theirs, size):
        rows.write(output / PARAMETERS, {**task, **parameter, **rows.provenance(SEED)})


def main() -> None:
    parser = rows.parser(__doc__)
    parser.add_argument("--case", choices=sorted(RELAXATION_TIMES), default="A")
    parser.add_argument("--live", type=int, default=LIVE)
    options = parser.parse_args()
    task: rows.Task = {"case": options.case, "live": options.live}
    if rows.missing(options.output / EVIDENCE, [task]):
        compare(options.case, options.live, options.output)


if __name__ == "__main__":
    main()
