"""Create a new study folder for a user to fill in."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from deabayes.faults import UserError
from deabayes.records.columns import COMMANDS
from deabayes.records.drafts import draft
from deabayes.records.marks import without_mark
from deabayes.records.schema import scalar, schema
from deabayes.records.table import WITHOUT_TIME, channels_of
from deabayes.systems import system_class

DISPLAY_UNITS = {"m": "mm", "m^2": "mm^2", "kg": "g", "V": "kV", "F": "nF", "Pa": "kPa"}
MEANINGS = {"control_voltage": "what was asked of the amplifier, on the scale of its output"}
METADATA = {
    "sine": "frequency_Hz",
    "quasi_static": "voltage_kV",
    "load_unload": "stretch_rate_per_s",
}

SPECIMEN = """\
# What was tested. Replace every `...`; then run `deabayes check {shell_folder}`.
name: {name}
system: {system}
provenance:
  kind: measured        # measured | simulated | digitised
  source: ...           # laboratory, paper or address
  licence: ...

# Properties of the specimen: a value with its unit (any that pint knows).
# With `sd` (same unit) a quantity becomes a parameter, log-normal about its value; without, exact.
quantities:
{required}
# These can be given too; remove the `#`.
{optional}
# Instruments: delay, range, resolution and noise of the response sensor, current_limit of the
# amplifier; all optional. A channel's name (voltage: ...) may hold the same keys.
instruments:
  # noise: {{value: ..., unit: {response_unit}}}
  # resolution: {{value: ..., unit: {response_unit}}}
  # range: {{value: ..., unit: {response_unit}}}
  # delay: {{value: ..., unit: ms}}

# Only for records without a header of names and units:
# record_format:
#   delimiter: ","       # or ";", tab, whitespace
#   header_lines: 2      # lines to skip, the header too if columns follow; empty ones not counted
#   columns:             # all of them, from left to right; name "-" leaves one out
{format_columns}{stated_format}"""

README = """\
One file per record, named in experiments.csv. Text files have a header of `name [unit]` or
`Name (unit)` per column, or a row of units below the names; commas, `;` or tabs between them:

    {header}

{pull}The columns that this system knows, in any unit of their kind:

{channels}
Excel (.xlsx, first sheet, same header), MATLAB (.mat) and TDMS files are read as well.
"""

PULL = """\
A pull (quasi_static) needs no column `time`, other records do. It needs the voltage that was
held: a column `voltage`, or `voltage_kV` in experiments.csv (0 without voltage).

"""

NEXT = """\
# The files are copied to {folder}. A ? stands behind each guess in experiments.csv and
# specimen.yaml. This lists the guesses, and what is left to fill in:
#   deabayes check {shell_folder}
"""

ENTRY = """\
# Add this under `studies:` in config.yaml, indented as it is:
  {name}:
    specimen: {folder}
    candidates: [{candidates}]
"""


def new_study(
    name: str, system: str | None, parent: Path = Path("data"), files: Sequence[Path] = ()
) -> str:
    """Write a commented study folder `parent/name` and return its entry for config.yaml.

    Parameters
    ----------
    system : its name; None guesses it from the files.
    files : records to copy into the folder; experiments.csv then has a row for each.

    Raises
    ------
    UserError : unknown system, a name that cannot be a folder, a folder that exists, or files that
        cannot be read.
    """
    pattern = schema("config")["properties"]["studies"]["propertyNames"]["pattern"]
    if not re.fullmatch(pattern, name):
        raise UserError(
            f"{name!r} cannot be a study's name; use letters from a to z, digits, '_', '-' and "
            "'.', beginning with a letter or digit"
        )
    folder = Path(parent) / name
    if folder.exists():
        raise UserError(f"{folder}: exists already and is not overwritten; choose another name")
    drafted = draft(files, system) if files or system is None else None
    written_system = system if drafted is None else drafted.system
    assert written_system is not None
    system = without_mark(written_system)
    kind = system_class(system)
    place = folder.as_posix()
    words = {"name": scalar(name), "system": scalar(written_system), **_channels(system)}
    words |= {"folder": scalar(place), "shell_folder": shlex.quote(place)}
    words["required"] = _quantity_lines(kind.required_quantities, kind.meanings, "  ")
    optional = _quantity_lines(kind.optional_quantities, kind.meanings, "  # ")
    words["optional"] = optional or "  # (none)\n"
    commands = {name: kind.excitations[of] for name, of in COMMANDS.items() if of in kind.in_time}
    known = {**kind.excitations, **commands, **kind.responses}
    words["channels"] = _channel_lines(known, {**MEANINGS, **kind.meanings})
    words["candidates"] = ", ".join(_candidates(system))
    words["stated_format"] = _stated_format({} if drafted is None else drafted.record_format)
    table = _table(system) if drafted is None else drafted.table
    (folder / "records").mkdir(parents=True)
    for target, file in {} if drafted is None else drafted.files.items():
        shutil.copyfile(file, folder / "records" / target)
    (folder / "specimen.yaml").write_text(SPECIMEN.format(**words), encoding="utf-8")
    (folder / "experiments.csv").write_text(table, encoding="utf-8")
    (folder / "records" / "README").write_text(README.format(**words), encoding="utf-8")
    return (ENTRY if drafted is None else NEXT + ENTRY).format(**words)


def _stated_format(settings: Mapping[str, str]) -> str:
    """Return a record_format with guesses, or the lines that explain it, for specimen.yaml."""
    pairs = ", ".join(f"{key}: '{value}'" for key, value in settings.items())
    return f"\nrecord_format: {{{pairs}}}   # a ? stands behind a guess\n" if pairs else ""


def _candidates(system: str) -> list[str]:
    from deabayes.systems import candidates

    return list(candidates(system)[:3])


def _channels(system: str) -> dict[str, str]:
    """Return a system's example channels, and the columns of their record in usual units."""
    protocol = system_class(system).protocols[0]
    excitations, responses = channels_of(system, protocol)
    excitation, response = next(iter(excitations)), next(iter(responses))
    units = {} if protocol in WITHOUT_TIME else {"time": "s"}
    units |= {excitation: excitations[excitation], response: responses[response]}
    pulled = protocol == "quasi_static" and "voltage" in excitations
    units |= {"voltage": "V"} if pulled else {}
    columns = {name: DISPLAY_UNITS.get(unit, unit) for name, unit in units.items()}
    lines = [f"#     - {{name: {name}, unit: {unit}}}\n" for name, unit in columns.items()]
    return {
        "excitation": excitation,
        "response": response,
        "response_unit": columns[response],
        "header": ",".join(f"{name} [{unit}]" for name, unit in columns.items()),
        "format_columns": "".join(lines),
        "pull": PULL if pulled else "",
    }


def _quantity_lines(quantities: Mapping[str, str], meanings: Mapping[str, str], indent: str) -> str:
    def line(name: str, unit: str) -> str:
        shown = DISPLAY_UNITS.get(unit, unit)
        meaning = meanings.get(name, "")
        comment = f"  # {meaning}" if meaning not in ("", name) else ""
        return f"{indent}{name}: {{value: ..., unit: {shown!r}, source: ...}}{comment}\n"

    return "".join(line(*quantity) for quantity in quantities.items())


def _channel_lines(channels: Mapping[str, str], meanings: Mapping[str, str]) -> str:
    lines = [f"{name} [{unit}]" for name, unit in channels.items()]
    said = [f": {meanings[name]}" if name in meanings else "" for name in channels]
    return "".join(f"    {line}{more}\n" for line, more in zip(lines, said, strict=True))


def _table(system: str) -> str:
    """Return experiments.csv with an example row to replace."""
    protocol = system_class(system).protocols[0]
    channels = _channels(system)
    extra = METADATA.get(protocol)
    header = ["name", "protocol", "record", "role", "excitation", "response", "load_g", "note"]
    row = [f"{protocol}_1", protocol, f"records/{protocol}_1.csv", "calibrate",
           channels["excitation"], channels["response"], "", "example row: replace it"]  # fmt: skip
    comment = (
        "# One row per record. protocol: " + " | ".join(system_class(system).protocols) + "; "
        "role: calibrate | validate; excitation and response name columns of the record.\n"
        "# Further columns (frequency_Hz, amplitude_kV, ...) are kept and shown in tables.\n"
    )
    lines = [[*header, extra], [*row, ""]] if extra else [header, row]
    return comment + "".join(",".join(line) + "\n" for line in lines)
