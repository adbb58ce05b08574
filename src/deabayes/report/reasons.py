"""Why a candidate did not converge, as a reader needs it: a sentence per gate, and what to do.

The posterior file has a sentence per gate and quantity.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Mapping
from typing import Any

LONGER = "; sample longer"
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
FEWER_IS_WORSE = ("only", "the bulk", "the tail")
"""How sentences begin whose smallest number is the worst."""


def grouped(convergence: Mapping[str, Any], sampling: Mapping[str, Any]) -> list[str]:
    """One sentence per gate that failed, about the worst quantity or run; then the advice, once.

    Parameters
    ----------
    convergence : as in a posterior file.
    sampling : the settings it was sampled with; without them no number is advised.
    """
    reasons = [str(each) for each in convergence.get("reasons") or ()]
    groups: dict[str, list[str]] = defaultdict(list)
    for reason in reasons:
        sentence = reason.removesuffix(LONGER)
        subject, _, text = sentence.partition(": ")
        groups[NUMBER.sub("#", text) if text else subject].append(sentence)
    found = [_worst(each) for each in groups.values()]
    if any(reason.endswith(LONGER) for reason in reasons):
        found.append(_advice(convergence, sampling))
    return found


def _worst(sentences: list[str]) -> str:
    if len(sentences) == 1:
        return sentences[0]
    sign = -1.0 if _text(sentences[0]).startswith(FEWER_IS_WORSE) else 1.0
    worst = max(sentences, key=lambda each: sign * _first_number(_text(each)))
    return f"{worst} (the worst of {len(sentences)})"


def _text(sentence: str) -> str:
    """What is said, without the quantity or run that it is said of."""
    return sentence.partition(": ")[2]


def _first_number(text: str) -> float:
    found = NUMBER.search(text)
    return float(found.group()) if found else 0.0


def _advice(convergence: Mapping[str, Any], sampling: Mapping[str, Any]) -> str:
    """How many steps it takes at the autocorrelation time, or effective draws, found so far."""
    limit = sampling.get("max_steps")
    if limit is None or "steps" not in convergence:
        return "Sample longer: double sampling.max_steps"
    gates = (
        ("autocorrelation_times", "autocorrelation_times_min"),
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
