"""Why a candidate did not converge, as a reader needs it: a sentence per gate, and what to do."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from typing import Any

from deabayes.sampling.diagnostics import Failed


def grouped(convergence: Mapping[str, Any], sampling: Mapping[str, Any]) -> list[str]:
    """One sentence per gate that failed, about the worst quantity or run; then the advice, once.

    Parameters
    ----------
    convergence : as in a posterior file.
    sampling : the settings it was sampled with; without them no number is advised.
    """
    failed = [Failed(**each) for each in convergence.get("failed_gates") or ()]
    gates: dict[str, list[Failed]] = defaultdict(list)
    for each in failed:
        gates[each.gate].append(each)
    of_gates = {str(each) for each in failed}
    others = [str(each) for each in convergence.get("reasons") or () if str(each) not in of_gates]
    advice = [_advice(convergence, sampling)] if any(each.longer for each in failed) else []
    return [*(_worst(each) for each in gates.values()), *others, *advice]


def _worst(failed: list[Failed]) -> str:
    worst = max(failed, key=lambda each: each.badness)
    many = f" (the worst of {len(failed)})" if len(failed) > 1 else ""
    return f"{worst.of}: {worst.text}{many}"


def _advice(convergence: Mapping[str, Any], sampling: Mapping[str, Any]) -> str:
    """How many steps it takes at the autocorrelation time, or effective draws, found so far."""
    limit = sampling.get("max_steps")
    if limit is None or "steps" not in convergence:
        return "Sample longer: double sampling.max_steps"
    gates = (
        ("autocorrelation_times", "length"),
        ("ess", "ess_bulk_min"),
        ("ess", "ess_tail_min"),
    )
    lacking = [
        float(sampling[gate]) / float(convergence[reached])
        for gate, reached in gates
        if gate in sampling and float(convergence.get(reached) or 0.0) > 0.0
    ]
    needed = max([2.0 * float(limit), *(each * convergence["steps"] for each in lacking)])
    return (
        f"Sample longer: set sampling.max_steps to {_rounded_up(needed)} or more (now {limit}), by "
        "what the runs tell so far of their autocorrelation time; docs/how-to/not-converged.md"
    )


def _rounded_up(steps: float) -> int:
    unit = 10 ** max(int(math.log10(steps)) - 1, 0)
    return math.ceil(steps / unit) * unit
