"""The draws of one independent ensemble, and where they came from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import UserError
from deabayes.files import write_netcdf_atomically
from deabayes.sampling.chains import ess_bulk
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.proposal import Proposal

LEAST_DROPPED = 0.1


@dataclass(frozen=True)
class Ensemble:
    """What one run of the ensemble sampler keeps, in z.

    Attributes
    ----------
    chain : (S, W, d), the last step included; `log_posterior` (S, W).
    proposal : frozen; the kept steps were made with it.
    steps : all steps made; the first `burn_in` of them are dropped, `thin` is the
        spacing of those kept.
    acceptance : share of proposals accepted.
    autocorrelation_time : in steps, of the slowest coordinate.
    replaced_walkers : walkers found stuck after the warm-up and started elsewhere.
    evaluations, failures : likelihood evaluations, and how many gave no finite value.
    enough : the run passed the gates that can be judged on one run alone.
    refitted : sampled with a proposal refitted to the ensembles' draws.
    """

    chain: FloatArray
    log_posterior: FloatArray
    proposal: Proposal
    steps: int
    burn_in: int
    thin: int
    acceptance: float
    autocorrelation_time: float
    replaced_walkers: int
    evaluations: int
    failures: int
    enough: bool
    refitted: bool = False

    @property
    def failed_share(self) -> float:
        """Share of likelihood evaluations that gave no finite value."""
        return self.failures / max(self.evaluations, 1)

    def followed_by(self, later: Ensemble) -> Ensemble:
        """This run and what came after it with the same proposal, spaced alike, as one.

        A tenth of all steps is dropped at least (`LEAST_DROPPED`).

        Parameters
        ----------
        later : counts this one's steps and evaluations among its own.
        """
        missing = LEAST_DROPPED * later.steps - self.burn_in
        more = max(0, ceil(missing / self.thin))
        chain = np.concatenate([self.chain, later.chain])[more:]
        smallest = min(ess_bulk(values) for values in np.moveaxis(chain, 2, 0)[:, None])
        burn_in = self.burn_in + more * self.thin
        kept = later.steps - burn_in
        before = (self.steps - burn_in) / kept
        return replace(
            later,
            chain=chain,
            log_posterior=np.concatenate([self.log_posterior, later.log_posterior])[more:],
            burn_in=burn_in,
            acceptance=before * self.acceptance + (1.0 - before) * later.acceptance,
            autocorrelation_time=float(kept * chain.shape[1] / smallest),
        )

    def write(self, path: Path) -> None:
        """Write to a netCDF file that appears complete or not at all."""
        import xarray as xr

        variables: dict[str, Any] = {
            "chain": (("step", "walker", "dimension"), self.chain),
            "log_posterior": (("step", "walker"), self.log_posterior),
        }
        for name, values in self.proposal.arrays().items():
            variables[name] = ([f"{name}_{axis}" for axis in range(values.ndim)], values)
        scalars = {name: _plain(getattr(self, name)) for name in _scalars()}
        dataset = xr.Dataset(variables, attrs=scalars)
        write_netcdf_atomically(dataset, path)

    @classmethod
    def read(cls, path: Path, coordinates: Coordinates) -> Ensemble:
        """Read what `write` wrote; its proposal begins in these coordinates.

        Raises
        ------
        UserError
            Some other file.
        """
        import xarray as xr

        try:
            with xr.open_dataset(path, engine="h5netcdf") as dataset:
                dataset = dataset.load()
            arrays = {str(n): v.values for n, v in dataset.items()}
            proposal = Proposal.from_arrays(arrays, coordinates)
            scalars = {name: kind(dataset.attrs[name]) for name, kind in _scalars().items()}
            return cls(arrays["chain"], arrays["log_posterior"], proposal, **scalars)
        except (KeyError, OSError):
            raise UserError(
                f"{path}: is no ensemble's file; give those that `deabayes fit --ensemble` wrote "
                "(its --output)"
            ) from None


def _scalars() -> dict[str, type]:
    kinds = {"int": int, "float": float, "bool": bool}
    return {field.name: kinds[str(field.type)] for field in fields(Ensemble) if field.type in kinds}


def _plain(value: float | bool) -> float | int:
    return int(value) if isinstance(value, bool) else value


def align(ensembles: Sequence[Ensemble]) -> tuple[FloatArray, FloatArray]:
    """Chains (E, S, W, d) and log-posteriors (E, S, W), each run thinned evenly to the shortest."""
    shortest = min(len(ensemble.chain) for ensemble in ensembles)
    kept = [
        np.linspace(0, len(ensemble.chain) - 1, shortest).round().astype(int)
        for ensemble in ensembles
    ]
    pairs = list(zip(ensembles, kept, strict=True))
    return (
        np.stack([ensemble.chain[index] for ensemble, index in pairs]),
        np.stack([ensemble.log_posterior[index] for ensemble, index in pairs]),
    )
