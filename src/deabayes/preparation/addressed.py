"""Steps that are for one record or one response only: whether there is such a one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from deabayes.experiment import PHASE
from deabayes.faults import nearest
from deabayes.reading.raw import ExperimentRow


def misaddressed(
    preparation: Mapping[str, Sequence[Mapping[str, object] | str] | None],
    rows: Sequence[ExperimentRow],
) -> list[str]:
    """What is wrong with the `record:` and `response:` of steps; empty if nothing is.

    Parameters
    ----------
    preparation : protocol -> its steps, as in config.yaml.
    rows : of experiments.csv, those that the study leaves out too: studies share steps.
    """
    faults = []
    for protocol, step, settings in _settings_of(preparation):
        own = [row for row in rows if row.protocol == protocol]
        known = {"record": {row.name for row in own}, "response": {row.response for row in own}}
        if "gain" in known["response"]:
            known["record"] |= {f"{name}{PHASE}" for name in known["record"]}
            known["response"].add("phase")
        faults += [
            f"preparation.{protocol}, {step}.{key}: "
            f"{_unknown(settings[key], key, protocol, sorted(names))}"
            for key, names in known.items()
            if own and settings.get(key) is not None and str(settings[key]) not in names
        ]
    return faults


def _unknown(given: object, key: str, protocol: str, known: Sequence[str]) -> str:
    if isinstance(given, list | tuple | Mapping):
        return f"expected one {key}, found {given!r}; write the step once for each"
    what = "name" if key == "record" else "response"
    return f"no {protocol} record has the {what} '{given}'{nearest(str(given), known)}"


def _settings_of(
    preparation: Mapping[str, Sequence[Mapping[str, object] | str] | None],
) -> Iterator[tuple[str, str, Mapping[str, object]]]:
    for protocol, steps in preparation.items():
        for step in steps or ():
            for name, settings in step.items() if isinstance(step, Mapping) else ():
                if isinstance(settings, Mapping):
                    yield protocol, name, settings
