"""Commands that use models and posteriors: predictions, simulated responses, exports."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from deabayes.cli.arguments import (
    CONDITIONS,
    CONFIG,
    EXISTING,
    RESULTS,
    TARGET,
    keep_inputs,
    named_values,
    one_posterior,
    posterior_files,
)
from deabayes.export import REGISTRY as FORMATS
from deabayes.faults import PredictionWarning, UserError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

PREDICTED = (".csv", ".nc")
"""Endings of a file with a prediction."""
NO_CSV = (".xlsx", ".xls", ".nc", ".mat", ".tdms", ".json", ".parquet")
"""Endings that a CSV file must not have, because the programs that open them could not read it."""
NOTES = ("noise_note", "model_note")
"""Attributes of a prediction that are no cautions, but that a reader must know too."""


@click.command()
@click.argument("posterior")
@RESULTS
@click.option("--prepared", type=EXISTING, help="Default: prepared/ of the posterior's study.")
@click.option("-o", "--output", type=TARGET, help="Folder; default: predictions/ beside it.")
@click.option("--errors", type=TARGET, help="Default: errors.csv beside the posterior.")
@click.option("--excitation", type=EXISTING, help="Predict this excitation instead of the records.")
@click.option("--response", help="With --excitation; default: the response of the calibration.")
@click.option("--protocol", help="With --excitation: protocol that it follows (see predict_with).")
@CONDITIONS
def predict(
    posterior: str,
    results: Path,
    prepared: Path | None,
    output: Path | None,
    errors: Path | None,
    excitation: Path | None,
    response: str | None,
    protocol: str | None,
    conditions: Sequence[str],
) -> None:
    """Predict every record, with three bands, and score the predictions.

    POSTERIOR is a file, a fitted candidate (STUDY/CANDIDATE), or the name of a
    fitted study (all its candidates).

    With --excitation FILE, predict the response to that excitation instead, and write it to
    -o FILE.csv or FILE.nc. FILE is a record with `time [s]` and the excitation, in any unit.
    POSTERIOR is then a file, a candidate, or a study with one fitted candidate.
    """
    if excitation is None:
        for name, value in (
            ("--response", response), ("--protocol", protocol), ("--condition", conditions)
        ):  # fmt: skip
            if value:
                raise UserError(f"{name} needs --excitation; give an excitation or leave it out")
        _predict_records(posterior_files([posterior], results), prepared, output, errors)
        return
    for name, path in (("--prepared", prepared), ("--errors", errors)):
        if path:
            raise UserError(f"{name} cannot be used with --excitation; leave one of them out")
    _predict_excitation(
        one_posterior(posterior, results), excitation, output, response, protocol, conditions
    )


def _predict_records(
    posteriors: Sequence[Path], prepared: Path | None, output: Path | None, errors: Path | None
) -> None:
    """Predict with every posterior of a study; print where the tables are."""
    from deabayes.pipeline import predict_candidate

    if len(posteriors) > 1 and (output or errors):
        raise UserError(
            f"-o and --errors need one posterior file, and the study has {len(posteriors)}; name "
            "one, or leave the options out"
        )
    for posterior in posteriors:
        table = errors or posterior.with_name("errors.csv")
        records = prepared or posterior.parent.parent / "prepared"
        keep_inputs(output, posterior, records)
        keep_inputs(errors, posterior, records, option="--errors")
        folder = output or posterior.with_name("predictions")
        for line in predict_candidate(posterior, records, folder, table):
            click.echo(line, err=True)
        click.echo(table)


def _predict_excitation(
    posterior: Path,
    excitation: Path,
    output: Path | None,
    response: str | None,
    protocol: str | None,
    conditions: Sequence[str],
) -> None:
    """Predict the response to the excitation in a record; print what a user must know."""
    from deabayes.api import cautions, open_posterior
    from deabayes.cli.drive import read_drive
    from deabayes.files import write_atomically
    from deabayes.own_models.loading import restore
    from deabayes.posteriors.storage import write_dataset

    if output is None or output.suffix not in PREDICTED:
        given = "" if output is None else f" {output}"
        raise UserError(f"-o{given}: name a file that ends in .csv or .nc for the prediction")
    keep_inputs(output, posterior, excitation)
    post = open_posterior(posterior)
    restore(post.data.attrs)
    drive: dict[str, Any] = read_drive(str(post.data.attrs["system"]), excitation)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PredictionWarning)  # each is a line on the terminal
        prediction = post.predict(
            response=response,
            protocol=protocol,
            conditions=named_values(conditions, "--condition"),
            **drive,
        )
    if output.suffix == ".nc":
        write_dataset(prediction, output)
    else:
        table = as_table(prediction)
        write_atomically(lambda path: table.to_csv(path, index=False), output)
    notes = (prediction.attrs[name] for name in NOTES)
    for text in (*cautions(prediction.attrs), *filter(None, notes)):
        _warn(output, text)


def _warn(output: Path, text: str) -> None:
    click.echo(f"{output}: {text}", err=True)


def as_table(prediction: xr.Dataset) -> pd.DataFrame:
    """One row per point, columns headed `name [unit]`; bands as `predictive_90_lower`.

    The last columns have no unit: `simulated`, `converged` and `extrapolated`, 1 or 0 in every
    row.
    """
    import pandas as pd

    coordinate, excitation = prediction["coordinate"], prediction["excitation"]
    response, unit = (prediction.attrs[name] for name in ("response_name", "response_unit"))
    columns = {
        f"{coordinate.attrs['name']} [{coordinate.attrs['units']}]": coordinate.values,
        f"{excitation.attrs['long_name']} [{excitation.attrs['units']}]": excitation.values,
        f"{response}_median [{unit}]": prediction["median"].values,
        f"{response}_mean [{unit}]": prediction["mean"].values,
    }
    for name in ("parameter", "discrepancy", "predictive"):
        for level in prediction["level"].values:
            for bound in prediction["bound"].values:
                values = prediction[name].sel(level=level, bound=bound).values
                columns[f"{name}_{100 * level:.0f}_{bound} [{unit}]"] = values
    columns["simulated"] = int(prediction.attrs["provenance"] == "simulated")
    columns["converged"] = int(prediction.attrs["converged"])
    columns["extrapolated"] = int(bool(prediction.attrs["extrapolation"]))
    return pd.DataFrame(columns)


@click.command()
@click.argument("system")
@click.argument("candidate")
@click.option("--specimen", type=EXISTING, required=True, help="Study folder (specimen.yaml).")
@click.option(
    "--excitation", type=EXISTING, required=True, help="A record with time and excitation."
)
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
    from deabayes.cli.drive import read_drive
    from deabayes.files import write_atomically
    from deabayes.own_models.loading import load_for
    from deabayes.prediction.simulate import simulate as simulate_response

    inputs = (specimen / "specimen.yaml", specimen / "experiments.csv")
    keep_inputs(output, excitation, config, *inputs)
    if output.suffix.lower() in NO_CSV:
        raise UserError(f"-o {output}: the command writes a CSV table; name it .csv")
    load_for(system, config)
    drive: dict[str, Any] = read_drive(system, excitation)
    response = simulate_response(
        system,
        candidate,
        parameters=named_values(settings, "--set"),
        specimen=specimen,
        conditions=named_values(conditions, "--condition"),
        **drive,
    )
    table = response.to_dataframe().reset_index()
    table.columns = [f"{name} [{response[name].attrs['units']}]" for name in table.columns]
    write_atomically(lambda path: table.to_csv(path, index=False), output)
    if "failure" in response.attrs:
        _warn(output, f"cells without a response are empty: {response.attrs['failure']}")


def complete_format(_context: object, _parameter: object, incomplete: str) -> list[str]:
    """Complete the name of a format in a shell."""
    return [name for name in FORMATS if name.startswith(incomplete)]


@click.command()
@click.argument("posterior")
@RESULTS
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
@click.option("--load-g", type=float, help="state-space: mass of the load in g  [default: 0]")
@click.option("--bias", help="state-space: linearise about this voltage ('2 kV').")
def export(posterior: str, results: Path, to: str, output: Path, **options: object) -> None:
    """Write POSTERIOR in another program's format.

    POSTERIOR is a file, a fitted candidate (STUDY/CANDIDATE), or the name of a
    study with one fitted candidate.

    csv, parquet, json, mat: every draw of every quantity, SI.

    state-space: A, B, C, D of every draw of a linear model, as .json or .mat by
    OUTPUT's ending. The input is the squared voltage, with --bias the voltage.

    abaqus (.inp), ansys (.mac or .inp): a material card of the medians, or with
    --draws numbered cards of as many draws.

    pymc, numpyro (.py): a Python function that defines the posterior's material
    and specimen parameters as a prior.
    """
    from deabayes.pipeline import export_posterior

    source = one_posterior(posterior, results)
    keep_inputs(output, source)
    converged, found = export_posterior(source, to, output, **options)
    for caution in found:
        _warn(output, caution)
    if not converged:
        _warn(output, "NOT CONVERGED, do not use these numbers")
