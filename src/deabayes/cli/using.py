"""Commands for other programs: responses, exports, predictions under a drive of one's own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from deabayes.cli.arguments import CONDITIONS, CONFIG, EXISTING, TARGET, keep_inputs
from deabayes.faults import Faults, UserError, nearest

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from deabayes.experiment import FloatArray
    from deabayes.records.columns import RawRecord

FORMATS = (
    "csv", "parquet", "json", "mat", "state-space", "abaqus", "ansys", "pymc", "numpyro",
)  # fmt: skip
"""Those of `deabayes.export.REGISTRY`, told without importing it."""


@click.command()
@click.argument("system")
@click.argument("candidate")
@click.option("--specimen", type=EXISTING, required=True, help="Study folder (specimen.yaml).")
@click.option("--excitation", type=EXISTING, required=True, help="A record with time and drive.")
@click.option(
    "--set", "settings", multiple=True, metavar="NAME=VALUE", help="A parameter, SI or with a unit."
)
@CONDITIONS
@click.option("-o", "--output", type=TARGET, required=True, help="response.csv")
@CONFIG
def simulate(
    system: str,
    candidate: str,
    specimen: Path,
    excitation: Path,
    settings: Sequence[str],
    conditions: Sequence[str],
    output: Path,
    config: Path,
) -> None:
    """Simulate the response of CANDIDATE of SYSTEM to an excitation record."""
    tables = (specimen / "specimen.yaml", specimen / "experiments.csv")
    keep_inputs(output, excitation, config, *tables)
    failure = simulate_record(
        system, candidate, specimen, excitation, settings, conditions, output, config
    )
    if failure:
        click.echo(f"{output}: cells are empty: {failure}", err=True)


def complete_format(_context: object, _parameter: object, incomplete: str) -> list[str]:
    """Complete the name of a format in a shell."""
    return [form for form in FORMATS if form.startswith(incomplete)]


@click.command()
@click.argument("posterior", type=EXISTING)
@click.option(
    "--to",
    required=True,
    metavar="FORMAT",
    help=f"One of {', '.join(FORMATS)}.",
    shell_complete=complete_format,
)
@click.option("-o", "--output", type=TARGET, required=True)
@click.option("--rate", help="state-space: also discrete, at this sample rate ('10 kHz').")
@click.option(
    "--draws",
    type=click.IntRange(min=1),
    help="state-space, abaqus, ansys: how many draws  [default: 200; of cards, the medians]",
)
@click.option("--load-g", type=float, help="state-space: hung mass in g  [default: 0]")
@click.option("--bias", help="state-space: linearise about this voltage ('2 kV').")
def export(posterior: Path, to: str, output: Path, **options: object) -> None:
    """Write POSTERIOR in another program's format.

    csv, parquet, json, mat: every draw of every quantity, SI.

    state-space: A, B, C, D of every draw of a linear model, as .json or .mat by
    OUTPUT's ending. The input is the squared voltage, with --bias the voltage.

    abaqus (.inp), ansys (.mac or .inp): a material card of the medians, or with
    --draws numbered cards of as many draws.

    pymc, numpyro (.py): a Python function that defines the posterior's material
    and specimen parameters as a prior.
    """
    from deabayes.pipeline import export_posterior

    keep_inputs(output, posterior)
    converged, cautions = export_posterior(posterior, to, output, **options)
    for caution in cautions:
        click.echo(f"{output}: {caution}", err=True)
    if not converged:
        click.echo(f"{output}: NOT CONVERGED, do not use these numbers", err=True)


def read_drive(system: str, path: Path) -> dict[str, FloatArray]:
    """Read the time and the driving channels of a record, in SI units.

    Raises
    ------
    UserError, Faults
        No column that drives the system, none called `time` where one is needed or some other
        is a time, values that cannot be followed.
    """
    from deabayes.records.columns import CHANNELS
    from deabayes.records.record import read_record
    from deabayes.systems import system_class

    kind = system_class(system)
    record = read_record(path, channels={**CHANNELS, **kind.excitations})
    wanted = ("time", *kind.excitations)
    driven = {name: values for name, values in record.columns.items() if name in wanted}
    drives = [name for name in driven if name != "time"]
    if not drives:
        raise UserError(
            f"{path}: has no column {' or '.join(kind.excitations)} to drive system {system!r}, "
            f"only {', '.join(record.columns)}"
        )
    steady = [name for name in drives if name in kind.without_time]
    if "time" in driven and steady == drives:
        raise UserError(
            f"{path}: {steady[0]} drives system {system!r} from one steady state to the next, at "
            "no time; remove the column 'time', and sort the rows so that the rest ascends"
        )
    if "time" not in driven:
        _check_without_time(record, [name for name in drives if name in kind.in_time], path)
    faults = _faults(driven, str(path), steady)
    if faults:
        raise Faults(faults)
    return driven


def _check_without_time(record: RawRecord, in_time: list[str], path: Path) -> None:
    """Refuse a record whose time has another name, or that needs a time and has none."""
    times = [name for name, unit in record.units.items() if unit == "s"]
    if times:
        raise UserError(
            f"{path}: column {times[0]!r} is a time but is not called so; write 'time [s]' with "
            "the unit it has, or remove the column where the drive is quasi-static"
        )
    if in_time:
        raise UserError(
            f"{path}: column 'time' is missing, {in_time[0]} drives the system in time"
            f"{nearest('time', record.columns)}; write its header as 'time [s]'"
        )


def _faults(driven: Mapping[str, FloatArray], where: str, steady: list[str]) -> list[str]:
    import numpy as np

    from deabayes.records.checks import not_finite, time_goes_back, time_repeats

    faults = [f for name, values in driven.items() for f in not_finite(values, name, where, "")]
    if faults:
        return faults
    if "time" in driven:
        return time_goes_back(driven["time"], where) + time_repeats(driven["time"], where, "")
    for name, values in driven.items():
        back = np.flatnonzero(np.diff(values) <= 0.0)
        if back.size:
            faults.append(
                f"{where}, column {name}: does not ascend at data row {back[0] + 2}, as a drive "
                "without time must; sort the rows"
                + ("" if name in steady else ", or give the time as a column 'time [s]'")
            )
    return faults


SUFFIXES = (".csv", ".nc")


def predict_record(
    posterior: Path,
    excitation: Path,
    output: Path | None,
    response: str | None,
    protocol: str | None,
    conditions: Sequence[str],
) -> list[str]:
    """Predict the response to the drive in a record; return what a user must know."""
    from deabayes.api import open_posterior
    from deabayes.files import write_atomically
    from deabayes.own_models.loading import restore
    from deabayes.posteriors.storage import write_dataset

    if output is None or output.suffix not in SUFFIXES:
        found = "" if output is None else f" {output}"
        raise UserError(f"-o{found}: --excitation needs a file to write, .csv or .nc")
    keep_inputs(output, posterior, excitation)
    held = dict(named(conditions, "--condition"))
    post = open_posterior(posterior)
    restore(post.data.attrs)
    driven: dict[str, Any] = read_drive(str(post.data.attrs["system"]), excitation)
    found = post.predict(response=response, protocol=protocol, conditions=held, **driven)
    if output.suffix == ".nc":
        write_dataset(found, output)
    else:
        table = as_table(found)
        write_atomically(lambda path: table.to_csv(path, index=False), output)
    return [f"{output}: {text}" for text in _to_be_known(found)]


def as_table(prediction: xr.Dataset) -> pd.DataFrame:
    """One row per point, columns headed `name [unit]`; bands as `predictive_90_lower`.

    The last columns have no unit: `simulated`, `converged` and `extrapolated`, 1 or 0 in every
    row.
    """
    import pandas as pd

    at, response = prediction["coordinate"], prediction.attrs["response_name"]
    excitation = prediction["excitation"]
    columns = {f"{at.attrs['name']} [{at.attrs['units']}]": at.values}
    columns[f"{excitation.attrs['long_name']} [{excitation.attrs['units']}]"] = excitation.values
    unit = prediction.attrs["response_unit"]
    for name in ("median", "mean"):
        columns[f"{response}_{name} [{unit}]"] = prediction[name].values
    for name in ("parameter", "discrepancy", "predictive"):
        for level in prediction["level"].values:
            for bound in prediction["bound"].values:
                values = prediction[name].sel(level=level, bound=bound).values
                columns[f"{name}_{100 * level:.0f}_{bound} [{unit}]"] = values
    columns["simulated"] = int(prediction.attrs["provenance"] == "simulated")
    columns["converged"] = int(prediction.attrs["converged"])
    columns["extrapolated"] = int(bool(prediction.attrs["extrapolation"]))
    return pd.DataFrame(columns)


def named(settings: Sequence[str], option: str) -> Iterator[tuple[str, float | str]]:
    """Split NAME=VALUE pairs; a value that is no number stays text.

    Raises
    ------
    UserError
    """
    once_each(settings, option)
    for setting in settings:
        name, _, value = (part.strip() for part in setting.partition("="))
        if not name or not value:
            raise UserError(f"{option} {setting!r}: expected NAME=VALUE")
        try:
            yield name, float(value)
        except ValueError:
            yield name, value


def once_each(settings: Sequence[str], option: str) -> None:
    """Refuse a name that is set twice.

    Raises
    ------
    UserError
    """
    names = [setting.partition("=")[0].strip() for setting in settings]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise UserError(f"{option}: {twice} is given twice; keep one")


def _to_be_known(prediction: xr.Dataset) -> Iterator[str]:
    attributes = prediction.attrs
    if not attributes["converged"]:
        yield "NOT CONVERGED, do not use these numbers"
    if attributes["extrapolation"]:
        yield f"extrapolation: {attributes['extrapolation']}"
    for name in ("failure", "noise_note", "model_note", "held_out_note"):
        if attributes[name]:
            yield str(attributes[name])


OTHER_FORMATS = (".xlsx", ".xls", ".nc", ".mat", ".tdms", ".json", ".parquet")
"""Endings that a CSV file may not have: what opens them would not read it."""


def simulate_record(
    system: str,
    candidate: str,
    specimen: Path,
    excitation: Path,
    settings: Sequence[str],
    conditions: Sequence[str],
    output: Path,
    config: Path,
) -> str:
    """Simulate the response to the drive in a record; write time, drive and response as CSV.

    Returns why the response ends or is missing, empty where it is whole.
    """
    from deabayes.files import write_atomically
    from deabayes.own_models.loading import load_for
    from deabayes.prediction.simulate import simulate

    if output.suffix.lower() in OTHER_FORMATS:
        raise UserError(f"-o {output}: a table is written, name it .csv")
    load_for(system, config)
    driven: dict[str, Any] = read_drive(system, excitation)
    response = simulate(
        system,
        candidate,
        parameters=dict(_values(settings)),
        specimen=specimen,
        conditions=dict(named(conditions, "--condition")),
        **driven,
    )
    table = response.to_dataframe().reset_index()
    table.columns = [f"{name} [{response[name].attrs['units']}]" for name in table.columns]
    write_atomically(lambda path: table.to_csv(path, index=False), output)
    return str(response.attrs.get("failure", ""))


def _values(settings: Sequence[str]) -> Iterator[tuple[str, float | str]]:
    """Split parameters given as NAME=VALUE, in SI units or with a unit."""
    from deabayes.units import NUMBER_AND_UNIT

    once_each(settings, "--set")
    for setting in settings:
        name, _, value = setting.partition("=")
        number, unit = match.groups() if (match := NUMBER_AND_UNIT.match(value)) else ("", "")
        if not number:
            raise UserError(
                f"--set {setting!r}: expected NAME=VALUE with a number in SI units, or with its "
                "unit, such as 'E_0=1.5 MPa'"
            )
        yield name.strip(), value if unit else float(number)
