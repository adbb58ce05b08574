"""Interface for other code: open a posterior, read it, predict with it, use it as a prior."""

from __future__ import annotations

import json
import warnings
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from deabayes.faults import PredictionWarning, UserError
from deabayes.posteriors.storage import picked, read_tree, stacked, sum_of_draws

if TYPE_CHECKING:
    import pandas as pd

    from deabayes.prior.from_posterior import PriorFromPosterior

KINDS = ("material", "specimen", "noise", "derived")
"""Kinds of quantities; not every posterior has all of them."""
CAUTIONS = ("unit_note", "failure", "held_out_note")
"""Attributes of a prediction that say why not to trust it, beside `converged`, `extrapolation`."""


class Posterior:
    """The posterior of one candidate, read from a `posterior.nc`.

    Reading, summarising and drawing need numpy and xarray only; `predict` loads
    the forward model.
    """

    def __init__(self, tree: xr.DataTree, path: Path | None = None) -> None:
        self._tree = tree
        self._path = path

    def __repr__(self) -> str:
        attributes = self._tree.attrs
        doubt = "" if self.converged else ", NOT CONVERGED"
        return (
            f"<Posterior of {attributes['candidate']} ({attributes['system']}, "
            f"{attributes['provenance']} records{doubt}): {', '.join(self.names)}>"
        )

    @property
    def data(self) -> xr.DataTree:
        """The whole DataTree, for ArviZ."""
        return self._tree

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sampled parameters, followed by the derived quantities."""
        return tuple(str(name) for name in self._tree["posterior"].data_vars)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of every quantity by name."""
        variables = self._tree["posterior"].data_vars
        return {str(name): str(variable.attrs["unit"]) for name, variable in variables.items()}

    @property
    def converged(self) -> bool:
        """Whether every convergence gate was passed; if not, do not trust the numbers."""
        return bool(self._tree["summary"]["converged"].values.all())

    @property
    def leaning(self) -> tuple[str, ...]:
        """One sentence per parameter that a bound of its prior limits, with the remedy."""
        return tuple(json.loads(self._tree.attrs.get("leaning", "[]")))

    def summary(self) -> pd.DataFrame:
        """Return one row per quantity: mean, sd, quantiles, diagnostics, units (as summary.csv)."""
        table = self._tree["summary"].to_dataset().to_dataframe().reset_index()
        return table.rename(columns={"quantity": "parameter"}).set_index("parameter")

    def draws(
        self, size: int | None = None, seed: int = 1, *, kinds: str | Collection[str] | None = None
    ) -> pd.DataFrame:
        """Return posterior draws in SI units, one row per draw and one column per quantity.

        `units` gives the unit of every column.

        Parameters
        ----------
        size
            Number of draws. Without it, all stored draws are returned, ensemble after ensemble.
        seed
            Picks the draws at random. `predict` uses the same draws for the same size and seed.
        kinds
            Kinds of quantities to return, all by default: ``"material"``, ``"specimen"``,
            ``"noise"`` and ``"derived"``. There is also ``"prior"`` with `predict_with`, and
            ``"population"`` and ``"reference"`` in a population. `simulate` takes the parameters
            of the first two kinds.

        Raises
        ------
        UserError
            A kind that the posterior does not have.
        """
        import pandas as pd

        posterior = self._tree["posterior"]
        kind_of = {name: str(posterior[name].attrs["kind"]) for name in self.names}
        known = list(dict.fromkeys(kind_of.values()))
        kinds = known if kinds is None else [kinds] if isinstance(kinds, str) else kinds
        wanted = [name for name in self.names if kind_of[name] in kinds]
        unknown = sorted(set(kinds).difference(known, KINDS))
        if unknown or not wanted:
            raise UserError(
                f"kinds: {', '.join(unknown or kinds) or 'none'}; the posterior has "
                f"{', '.join(known)}"
            )
        columns = {name: stacked(posterior, name) for name in wanted}
        rows = picked(next(iter(columns.values())).size, size, seed)
        return pd.DataFrame({name: values[rows] for name, values in columns.items()})

    def predict(
        self,
        *,
        response: str | None = None,
        size: int = 500,
        seed: int = 1,
        conditions: dict[str, float | str] | None = None,
        protocol: str | None = None,
        **channels: ArrayLike,
    ) -> xr.Dataset:
        """Predict the response to an excitation, with three bands.

        Parameters
        ----------
        response
            Response channel; by default the one of the calibration records.
        size
            Number of posterior draws.
        seed
            Picks the draws, and draws the noise.
        conditions
            Conditions held during the experiment (`deformation`, `load_g`).
        protocol
            Protocol of the experiment (`sine`, `frequency_response`, ...). If the study names a
            wider candidate for this protocol (`predict_with`), that candidate solves the
            prediction. The noise is that of calibrated records of this protocol. By default, the
            fitted candidate solves the prediction.
        **channels
            `time=` [s] and one excitation channel (`voltage=`, `stretch=`, ...). The excitation
            is linear between its values. If the many values of a voltage are samples of
            a smooth curve, this curve is used (twelve neighbours on one polynomial). A single
            value is held. Without `time`, the excitation is quasi-static. Numbers are SI unless
            they carry a unit: ``"1.8 kV"``, a pint quantity, a DataArray with `units`, a Series
            called ``voltage [kV]``.

        Returns
        -------
        xarray.Dataset
            ``["median"]``, ``["mean"]`` and the bands `parameter`, `discrepancy` and
            `predictive` (level, bound, coordinate), with levels 0.5 and 0.9 and bounds
            `lower` and `upper`; `coordinate` is the time. Some attributes are notes, which are
            empty if there is nothing to say. `extrapolation` says where the excitation leaves the
            calibrated region. `unit_note` says that a voltage may be in kV and not in V.
            `failure` says how many draws have no response, and why. `held_out_note` says where
            the bands missed held-out records, or that the scores (errors.csv) are not beside the
            file. `noise_note` says if the noise, or its size, comes from other records.
            `model_note` says which candidate solved the prediction, if the study names a wider
            candidate for some protocols. `step` is the time of the excitation's only step [s],
            NaN without one.

        Warns
        -----
        deabayes.PredictionWarning
            The posterior did not converge, or one of the first four notes is not empty.

        Raises
        ------
        UserError
            Unknown channels, conditions or protocols; values in a wrong unit or of unlike length.
        """
        from deabayes.posteriors.fitted import Fitted
        from deabayes.prediction.bands import to_dataset

        fitted = Fitted.from_tree(self._tree, size, seed)
        experiment = fitted.experiment(channels, response, conditions or {}, protocol)
        samples = fitted.sample(experiment, np.random.default_rng(seed))
        dataset = to_dataset(
            experiment,
            samples,
            {
                "extrapolation": fitted.extrapolation(experiment),
                "unit_note": fitted.unit_note(experiment),
                "converged": int(fitted.converged),
                "model_note": fitted.model_note(experiment, protocol),
                "noise_group": fitted.noise_of(experiment).group,
                "held_out_note": self._held_out_note(),
            },
        )
        for caution in cautions(dataset.attrs):
            warnings.warn(caution, PredictionWarning, stacklevel=2)
        return dataset.drop_vars(["observed", "pit"])

    def _held_out_note(self) -> str:
        """Say what held-out records show about the bands; empty for a tree without a file."""
        from deabayes.prediction.errors import note_beside

        if self._path is None:
            return ""
        none_held_out = json.loads(self._tree.attrs["study"]).get("validate") == []
        return note_beside(self._path, sum_of_draws(self._tree), none_held_out)

    def as_prior(self) -> PriorFromPosterior:
        """Return material and specimen parameters, with correlations, as another study's prior."""
        from deabayes.posteriors.inheritance import handed_on

        return handed_on(self._tree)


def cautions(attributes: Mapping[Any, Any]) -> Iterator[str]:
    """Yield a sentence per reason not to trust a prediction with these attributes."""
    if not attributes["converged"]:
        yield "NOT CONVERGED, do not use these numbers"
    if attributes["extrapolation"]:
        yield f"extrapolation: {attributes['extrapolation']}"
    yield from (attributes[name] for name in CAUTIONS if attributes[name])


def open_posterior(path: str | Path) -> Posterior:
    """Open `results/{study}/{candidate}/posterior.nc`.

    Parameters
    ----------
    path
        The file. An `errors.csv` beside it tells predictions which held-out records were missed.

    Raises
    ------
    UserError
        If the file is missing, is no posterior file, or comes from another version whose content
        this version does not know.
    """
    return Posterior(read_tree(path), Path(path))


__all__ = ["Posterior", "open_posterior"]
