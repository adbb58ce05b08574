"""The tables and the posterior file of a population, by hand."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from tests.shared.populations import parameter

from deabayes.population.coordinate import Coordinate
from deabayes.population.files import (
    PopulationContent,
    population_tree,
    shrinkage_table,
    summary_table,
)
from deabayes.population.settings import Population
from deabayes.population.specimens import Shrunken
from deabayes.prior.distributions import LogNormal, Normal
from deabayes.prior.joint import Prior
from deabayes.sampling.diagnostics import Failed, summarise
from deabayes.sampling.engine import Sampled

PARAMETERS = (
    parameter("mu", LogNormal(1e4, 1.0)),
    parameter("shift", Normal(0.0, 3.0), "m"),
)
LADDER = np.linspace(0.0, 1.0, 101)


def member(study, converged=True, provenance="measured"):
    """phi of mu from log 1e4 up to log 2e4, of shift from 0 to -1 m, in 101 even draws."""
    phi = np.column_stack([np.log(1e4) + np.log(2.0) * LADDER, -LADDER])
    return SimpleNamespace(
        study=study, phi=phi, converged=converged, provenance=provenance,
        likelihood=SimpleNamespace(misfit=0.03),
    )  # fmt: skip


def content(members):
    """Two chains of 40 draws; weights that leave the upper half of a member's draws."""
    rng = np.random.default_rng(1)
    means = (
        parameter("mean_mu", LogNormal(1e4, 1.0)), parameter("mean_shift", Normal(0.0, 3.0), "m"),
        parameter("spread_mu", LogNormal(0.1, 1.0), "1"),
        parameter("spread_shift", LogNormal(0.1, 1.0), "m"),
    )  # fmt: skip
    coordinate = Coordinate.of(PARAMETERS)
    model = SimpleNamespace(coordinate=coordinate, members=members, prior=Prior(means))
    theta = rng.random((2, 40, 4))
    table = summarise({p.name: theta[..., k, None] for k, p in enumerate(means)})
    convergence = SimpleNamespace(
        converged=True, failed=[], table=table, mode_shares=None,
        autocorrelation_times=np.array([60.0]), length=60.0,
    )  # fmt: skip
    pooled = Sampled(
        theta[:, :, None], np.zeros((2, 40, 1)), convergence,
        steps=60, burn_in=20, thin=1, rounds=1, acceptance=0.3, evaluations=9, failures=0,
    )  # fmt: skip
    weights = np.where(LADDER > 0.499, 1.0, 0.0)
    shrunken = Shrunken(
        weights / weights.sum(), 500.0, 0.2, np.array([0.4, 0.7]), np.array([0.9, 0.003])
    )
    draws = {"mu": "material", "shift": "specimen", "step.sigma_white": "noise", "mu_0": "derived"}
    first = xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset(
                {
                    name: (("chain", "draw"), 100.0 * k + np.arange(80.0).reshape(2, 40),
                           {"symbol": name, "unit": "Pa", "kind": kind, "description": name})
                    for k, (name, kind) in enumerate(draws.items())
                }
            )
        }
    )  # fmt: skip
    first.attrs.update(study="{}", specimen="{}", noise="white", convergence="{}")
    return PopulationContent(
        Population("strips", tuple(m.study for m in members), "kv_gm_1", ("mu", "shift")),
        model, pooled, theta, np.zeros((2, 40)), rng.random((2, 40, 2)),
        [shrunken] * len(members), ["a warning"], first, np.arange(80)[::-1],
    )  # fmt: skip


@pytest.fixture(scope="module")
def made():
    return content([member("a"), member("b"), member("c", converged=False, provenance="simulated")])


def test_shrinkage_table_has_estimates_without_and_with_the_population(made):
    table = shrinkage_table(made).set_index(["study", "parameter"])
    row = table.loc[("b", "mu")]
    assert row[["q05", "median", "q95"]].tolist() == pytest.approx(
        [1e4 * 2.0**share for share in (0.05, 0.5, 0.95)]
    )
    # of the shares 0.50, 0.51, ..., 1.00, alike in weight
    shrunken = row[["shrunken_q05", "shrunken_median", "shrunken_q95"]].astype(float)
    assert np.log2(shrunken / 1e4).tolist() == pytest.approx([0.525, 0.75, 0.975], abs=0.006)
    assert row["unit"] == "Pa" and row["shrinkage"] == 0.4 and row["tail_probability"] == 0.9
    shift = table.loc[("b", "shift")]
    assert shift[["q05", "median", "q95"]].tolist() == pytest.approx([-0.95, -0.5, -0.05])
    assert shift["unit"] == "m" and shift["shrinkage"] == 0.7 and shift["tail_probability"] == 0.003
    assert shift["reliable"] and shift["misfit"] == 0.03
    assert (shift["effective_draws"], shift["k_hat"]) == (500.0, 0.2)
    assert table["converged"].tolist() == [True, True, True, True, False, False]
    assert table.loc[("c", "mu"), "provenance"] == "simulated"


def test_the_summary_has_the_new_specimen_then_means_and_spreads(made):
    table = summary_table(made)
    assert list(table.index) == [
        "mu", "shift", "mean_mu", "mean_shift", "spread_mu", "spread_shift",
    ]  # fmt: skip
    assert table["unit"].tolist() == ["Pa", "m", "Pa", "m", "1", "m"]
    assert table.loc["shift", "median"] == pytest.approx(np.median(made.new[..., 1]))
    assert table.loc["spread_mu", "mean"] == pytest.approx(made.theta[..., 2].mean())
    assert not table["converged"].any()


def test_a_population_does_not_converge_if_a_member_did_not(made):
    assert made.convergence["reasons"] == ["c: its own posterior has not converged"]
    assert not made.convergence["converged"]
    whole = content([member("a"), member("b")])
    assert whole.convergence["converged"]
    whole.pooled.convergence.failed.append(Failed("length", "run 1", "too short", -9.0))
    assert whole.convergence["reasons"] == ["population, run 1: too short; sample longer"]
    assert whole.convergence["failed_gates"][0]["of"] == "population, run 1"


def test_the_file_describes_a_new_specimen_with_the_first_members_rest(made):
    tree = population_tree(made)
    posterior = tree["posterior"]
    np.testing.assert_array_equal(posterior["shift"], made.new[..., 1])
    np.testing.assert_array_equal(posterior["spread_mu"], made.theta[..., 2])
    assert posterior["spread_mu"].attrs["kind"] == "population"
    noise = posterior["step.sigma_white"]
    assert noise.attrs["kind"] == "reference"
    np.testing.assert_array_equal(noise.values.ravel(), 200.0 + np.arange(80)[::-1])
    assert "mu_0" not in posterior
    assert tree.attrs["provenance"] == "simulated" and tree.attrs["noise"] == "white"
    assert json.loads(tree.attrs["warnings"]) == ["a warning"]
    specimens = tree["specimens"]
    assert specimens["specimen"].values.tolist() == ["a", "b", "c"]
    drawn = specimens["mu"].sel(specimen="b").values
    assert drawn.min() > 1.41e4 and drawn.max() <= 2.0001e4
    assert np.median(drawn) == pytest.approx(1e4 * 2.0**0.75, rel=0.02)
