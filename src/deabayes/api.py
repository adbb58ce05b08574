"""What other code uses: open a posterior, read it, predict with it, make it a prior."""

from __future__ import annotations

import json
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from deabayes.faults import UserError
from deabayes.posteriors.storage import picked, read_tree, stacked, sum_of_draws

if TYPE_CHECKING:
    import pandas as pd

    from deabayes.prior.from_posterior import PriorFromPosterior

KINDS = ("material", "specimen", "noise", "derived")
"""Of quantities; not every posterior has all."""


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
        """Sampled parameters, then derived quantities."""
        return tuple(str(name) for name in self._tree["posterior"].data_vars)

    @property
    def units(self) -> dict[str, str]:
        """Quantity -> SI unit."""
        variables = self._tree["posterior"].data_vars
        return {str(name): str(variable.attrs["unit"]) for name, variable in variables.items()}

    @property
    def converged(self) -> bool:
        """Whether every convergence gate was passed; if not, the numbers are not to be trusted."""
        return bool(self._tree["summary"]["converged"].values.all())

    @property
    def leaning(self) -> tuple[str, ...]:
        """A sentence on every parameter that leans on a bound of its prior, with what to write."""
        return tuple(json.loads(self._tree.attrs.get("leaning", "[]")))

    def summary(self) -> pd.DataFrame:
        """One row per quantity: mean, sd, quantiles, diagnostics, units (as summary.csv)."""
        table = self._tree["summary"].to_dataset().to_dataframe().reset_index()
        return table.rename(columns={"quantity": "parameter"}).set_index("parameter")

    def draws(
        self, size: int | None = None, seed: int = 1, *, kinds: str | Collection[str] | None = None
    ) -> pd.DataFrame:
        """Draws, one row each and one column per quantity, SI; `units` says which units.

        Parameters
        ----------
        size, seed : how many, and the seed that picks them at random; `predict` uses the same
            for the same two. Without a size all stored draws, ensemble after ensemble.
        kinds : of ``"material"``, ``"specimen"``, ``"noise"`` and ``"derived"`` (``"prior"`` with
            `predict_with`, ``"population"`` and ``"reference"`` of a population), all by default;
            the first two are the parameters that `simulate` takes.
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
        response : response channel; by default that of the calibration records.
        size, seed : number of posterior draws, and the seed that picks them.
        conditions : what is held (`deformation`, `load_g`).
        protocol : of which protocol it is (`sine`, `frequency_response`, ...): it is solved by
            the wider candidate where the study names one for it (`predict_with`), and has the
            noise of calibrated records of that protocol; by default the fitted candidate solves
            it.
        **channels : `time=` [s] and one excitation channel (`voltage=`, `stretch=`, ...),
            linear between its values, or the smooth curve that a voltage's many values are
            samples of (twelve neighbours on one polynomial); one value is held. Without `time`
            the excitation is quasi-static. Numbers are SI unless they carry a unit: ``"1.8 kV"``,
            a pint quantity, a DataArray with `units`, a Series called ``voltage [kV]``.

        Returns
        -------
        xarray.Dataset
            ``["median"]``, ``["mean"]`` and the bands `parameter`, `discrepancy` and
            `predictive` (level, bound, coordinate), with levels 0.5 and 0.9 and bounds
            `lower` and `upper`; `coordinate` is the time. The attribute
            `extrapolation` is not empty where the excitation leaves the
            calibrated region, `noise_note` where no calibration record measured
            this response and the noise is another one's, or where its size is a
            calibration record's. `model_note` says which candidate solved it, where the
            study names a wider one for some protocols. `held_out_note` says where the
            study's held-out records were missed by their bands, or that their scores
            (errors.csv) are not beside the file.
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
                "converged": int(fitted.converged),
                "model_note": fitted.model_note(experiment, protocol),
                "noise_group": fitted.noise_of(experiment).group,
                "held_out_note": self._held_out_note(),
            },
        )
        return dataset.drop_vars(["observed", "pit"])

    def _held_out_note(self) -> str:
        """What held-out records say of the bands; a tree without a file has nothing beside it."""
        from deabayes.prediction.errors import note_beside

        if self._path is None:
            return ""
        none_held_out = json.loads(self._tree.attrs["study"]).get("validate") == []
        return note_beside(self._path, sum_of_draws(self._tree), none_held_out)

    def as_prior(self) -> PriorFromPosterior:
        """The material and specimen parameters as a prior for another study, correlations kept."""
        from deabayes.posteriors.inheritance import handed_on

        return handed_on(self._tree)


def open_posterior(path: str | Path) -> Posterior:
    """Open `results/{study}/{candidate}/posterior.nc`.

    Raises
    ------
    UserError
        If the file is missing, is no posterior file, or one of another version that keeps what
        this one does not know.
    """
    return Posterior(read_tree(path), Path(path))


__all__ = ["Posterior", "open_posterior"]
