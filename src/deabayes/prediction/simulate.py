"""`deabayes.simulate`: a candidate's response for given parameters, without records."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from deabayes.experiment import Excitation, FloatArray, Specimen
from deabayes.faults import Faults, UserError, nearest
from deabayes.prediction.given import array_in_si, excitation_of
from deabayes.prior.parameter import Parameter
from deabayes.systems import build
from deabayes.systems.base import System


def simulate(
    system: str,
    candidate: str,
    parameters: Mapping[str, ArrayLike],
    specimen: str | Path | Mapping[str, Any],
    time: ArrayLike | None = None,
    response: str | None = None,
    conditions: Mapping[str, float | str] | None = None,
    **excitation: ArrayLike,
) -> xr.Dataset:
    """Compute a candidate's response to an excitation, for one or many parameter values.

    Parameters
    ----------
    system
        Name of the system, such as ``"tubular"``.
    candidate
        Name of the model, such as ``"voigt_kelvin_2"``.
    parameters
        One value or an array of draws (W,) per parameter, in SI or with a unit (``"1.5 MPa"``).
        Give a mapping, a DataFrame of draws or one of its rows
        (``posterior.draws(kinds=("material", "specimen"))``). You may also give a quantity of
        the specimen that has an sd; otherwise its value in `specimen` is used.
    specimen
        A study folder, or a mapping of the specimen's quantities (``{"thickness": 80e-6}`` in
        SI, ``"80 um"``, or ``{"value": 80, "unit": "um", "sd": 2}``).
    time
        (N,) [s] or time spans, ascending; without `time` the excitation is quasi-static.
    response
        Response channel; by default the system's response to this excitation.
    conditions
        Conditions held during the record (`deformation`, `load_g`).
    **excitation
        One channel (N,) in SI or with a unit: ``voltage=``, ``stretch=``, ... It is linear
        between its values. If many values of a voltage sample a smooth curve (twelve neighbours
        on one polynomial), that curve is used. A single value is held.

    Returns
    -------
    xarray.Dataset
        The response (draw, time), the excitation (time) and the parameters (draw), all with
        `units`. There is no dimension `draw` if every parameter is a single value. The response
        of a failed draw is NaN. The attribute `failed_draws` counts failed draws, and `failure`
        explains them (pull-in: at which time and voltage).

    Raises
    ------
    UserError
        Missing, unknown or impossible parameters (all are listed), channels, conditions or
        quantities; arrays of different lengths.

    Examples
    --------
    >>> import numpy as np
    >>> import deabayes
    >>> time = np.linspace(0.0, 0.5, 6)
    >>> creep = deabayes.simulate(
    ...     "tubular",
    ...     "voigt_kelvin_1",
    ...     parameters={"E_0": 1.5e6, "E_1": 6e6, "tau_1": 0.1},
    ...     specimen={"thickness": 80e-6, "relative_permittivity": 3.1},
    ...     time=time,
    ...     voltage=np.full(6, 2000.0),
    ... )
    >>> round(float(creep.strain[0]), 5)
    0.01144
    """
    model = build(system, candidate, _specimen(system, specimen))
    driven, coordinate_name = excitation_of(model, time, excitation, conditions or {})
    response = response or model.response_to(driven.name)
    if not hasattr(parameters, "items"):
        raise UserError(
            f"parameters: give names with values, such as {{'E_0': 1.5e6}}; found {parameters!r}"
        )
    draws, scalar = _draws(model, dict(parameters.items()))
    values = model.predict(driven, driven.coordinate, response, draws)
    failed = ~np.all(np.isfinite(values), axis=1)
    values = np.where(failed[:, None], np.nan, values)
    dataset = _dataset(model, driven, coordinate_name, response, values, draws)
    dataset.attrs["failed_draws"] = int(failed.sum())
    if failed.any():
        lost = {n: np.ascontiguousarray(drawn[failed]) for n, drawn in draws.items()}
        dataset.attrs["failure"] = model.failure_note(driven, driven.coordinate, lost)
    return dataset.squeeze("draw") if scalar else dataset


def _specimen(system: str, given: str | Path | Mapping[str, Any]) -> Specimen:
    from deabayes.records.specimen import read_specimen, specimen_from_quantities

    if isinstance(given, Mapping):
        return specimen_from_quantities(system, given)
    if not isinstance(given, str | PathLike):
        raise UserError(
            f"specimen: give a study folder or a mapping of quantities; found {given!r}"
        )
    if Path(given).is_file():
        raise UserError(f"{given}: is a file; name its folder {Path(given).parent}")
    specimen = read_specimen(Path(given))
    if specimen.system != system:
        raise UserError(
            f"{given} describes a specimen of system {specimen.system!r}, not {system!r}; name "
            "another folder or the other system"
        )
    return specimen


def _draws(model: System, given: Mapping[str, ArrayLike]) -> tuple[dict[str, FloatArray], bool]:
    """Return every parameter as (W,), and whether all were given as single values."""
    needed = {p.name: p for p in model.parameters()}
    quantities = {n: q.value for n, q in model.stated().items() if n in needed}
    faults = _name_faults(model.candidate, needed, given, quantities)
    arrays = {name: np.asarray(value) for name, value in quantities.items()}
    for name, value in given.items():
        try:
            unit = needed[name].unit if name in needed else "1"
            arrays[name] = array_in_si(value, unit, f"parameter {name}")
        except UserError as error:
            faults.append(str(error))
    faults += _impossible(needed.values(), arrays)
    sizes = {array.size for array in arrays.values() if array.ndim == 1}
    if len(sizes) > 1 or any(array.ndim > 1 for array in arrays.values()):
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        faults.append(f"parameters must be single values or arrays of one length; found {shapes}")
    else:
        faults += _opposed(needed.values(), arrays)
    if faults:
        raise Faults(faults)
    size = sizes.pop() if sizes else 1
    scalar = all(array.ndim == 0 for array in arrays.values())
    return {name: np.full(size, arrays[name]) for name in needed}, scalar


def _name_faults(
    candidate: str,
    needed: Mapping[str, Parameter],
    given: Mapping[str, ArrayLike],
    quantities: Mapping[str, float],
) -> list[str]:
    """List missing parameters and unknown names."""
    lacking = [
        f"{candidate} lacks parameter {name!r} [{parameter.unit}]: {parameter.description}"
        for name, parameter in needed.items()
        if name not in given and name not in quantities
    ]
    return lacking + [
        f"{candidate} has no parameter {name!r}{nearest(name, needed)}"
        for name in given
        if name not in needed
    ]


def _impossible(parameters: Iterable[Parameter], arrays: Mapping[str, FloatArray]) -> Iterator[str]:
    """Yield single values that are impossible; in an array of draws they make that draw fail."""
    for parameter in parameters:
        value = arrays.get(parameter.name, np.ones(2))
        if value.ndim > 0 or (np.isfinite(value) and (value >= 0.0 or _signed(parameter))):
            continue
        needed = "finite" if _signed(parameter) else "finite and not negative"
        yield f"parameter {parameter.name} is {value:g} {parameter.unit}; it must be {needed}"


def _signed(parameter: Parameter) -> bool:
    return parameter.prior.support[0] < 0.0 or parameter.half_product_with is not None


def _opposed(parameters: Iterable[Parameter], arrays: Mapping[str, FloatArray]) -> Iterator[str]:
    """Yield pairs with a negative product, which is wrong although such draws have a response."""
    for parameter in parameters:
        name, other = parameter.name, parameter.half_product_with
        if other is None or name not in arrays or other not in arrays:
            continue
        first, second = np.broadcast_arrays(arrays[name], arrays[other])
        wrong = np.argwhere(first * second < 0.0)
        if len(wrong):
            at = tuple(wrong[0])
            where = f" in draw {at[0]}" if at else ""
            yield (
                f"parameter {name} is {first[at]:g} {parameter.unit} and {other} is "
                f"{second[at]:g}{where}; both must have the same sign"
            )


def _dataset(
    model: System,
    excitation: Excitation,
    coordinate_name: str,
    response: str,
    values: FloatArray,
    draws: Mapping[str, FloatArray],
) -> xr.Dataset:
    """Return the dataset of response, excitation and parameters with their units."""
    along = coordinate_name
    variables: dict[str, Any] = {
        response: (("draw", along), values, {"units": model.responses[response]})
    }
    if along != excitation.name:
        variables[excitation.name] = (along, excitation.values, {"units": excitation.unit})
    for parameter in model.parameters():
        attributes = {"units": parameter.unit, "symbol": parameter.symbol}
        variables[parameter.name] = ("draw", draws[parameter.name], attributes)
    unit = "s" if along == "time" else excitation.unit
    return xr.Dataset(
        variables,
        {along: (along, excitation.coordinate, {"units": unit})},
        {
            "system": model.name,
            "candidate": model.candidate,
            "response": response,
            "excitation": excitation.name,
            **{f"condition_{name}": value for name, value in excitation.conditions.items()},
        },
    )
