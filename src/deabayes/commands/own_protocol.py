"""`deabayes predict --excitation`: what a posterior says of a drive of one's own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deabayes.commands.drive import read_drive
from deabayes.commands.output import keep_inputs
from deabayes.faults import UserError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

SUFFIXES = (".csv", ".nc")


def predict_record(
    posterior: Path,
    excitation: Path,
    output: Path | None,
    response: str | None,
    protocol: str | None,
    conditions: Sequence[str],
) -> list[str]:
    """Predict the response to the drive in a record; what is to be known of it, a line each."""
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

    Last, without a unit, what must not be lost with the terminal: `simulated`, `converged` and
    `extrapolated`, 1 or 0 in every row.
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
    """NAME=VALUE pairs; a value that is no number stays a text.

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
    """Refuse a name that is set twice; which value was meant cannot be told.

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
