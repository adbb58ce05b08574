"""The columns prior_sensitivity and likelihood_sensitivity of a posterior file."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tests.posteriors.test_predict_with import STUDY, UNCERTAIN, creep, draws

import deabayes
from deabayes.experiment import FloatArray
from deabayes.inference.log_posterior import LogPosterior, build, log_standard_normal
from deabayes.posteriors.content import PosteriorContent
from deabayes.posteriors.file import SUMMARY_COLUMNS, posterior_tree
from deabayes.posteriors.sensitivity import SENSITIVE
from deabayes.posteriors.storage import write_tree
from deabayes.prior.joint import PriorFromPosterior

SIZE = (2, 4000)
COLUMNS = ["prior_sensitivity", "likelihood_sensitivity"]


@pytest.fixture(scope="module")
def target() -> LogPosterior:
    return build(STUDY, "voigt_kelvin_2", UNCERTAIN, [creep()])


def file(
    target: LogPosterior, z: FloatArray, log_likelihood: FloatArray, effective: float = 8000.0
) -> xr.DataTree:
    """A posterior file whose log-likelihood (S,) is made up for draws z (S, d)."""
    names = [*target.names, *target.system.derived(draws())]
    table = pd.DataFrame(effective, index=names, columns=[*SUMMARY_COLUMNS])
    log_posterior = (log_likelihood + log_standard_normal(z)).reshape(SIZE)
    content = PosteriorContent(
        STUDY, "voigt_kelvin_2", UNCERTAIN, target, z.reshape(*SIZE, -1), log_posterior, table,
        {"converged": True, "reasons": []}, [], np.random.SeedSequence(3),
    )  # fmt: skip
    return posterior_tree(content)


def summary(tree: xr.DataTree) -> pd.DataFrame:
    return tree["summary"].to_dataset().to_dataframe()


def test_a_fit_to_nothing_moves_with_its_prior_alone(target: LogPosterior) -> None:
    """Every parameter, ordered ones and ones with bounds too; derived quantities as well."""
    z = np.random.default_rng(5).standard_normal((np.prod(SIZE), target.dimension))
    table = summary(file(target, z, np.full(len(z), -7.0)))
    assert list(table.columns) == list(SUMMARY_COLUMNS)
    assert list(table.columns)[-3:] == [*COLUMNS, "converged"]
    assert (table["likelihood_sensitivity"] < 1e-4).all()
    assert (table.loc[list(target.names), "prior_sensitivity"] > SENSITIVE).all()
    assert (table["prior_sensitivity"] > 0.02).all()


def test_an_inherited_prior_counts_as_prior() -> None:
    rng = np.random.default_rng(6)
    theta = np.exp(np.log([1e6, 2e6]) + rng.standard_normal((2000, 2)) @ [[0.1, 0.09], [0.0, 0.05]])
    inherited = PriorFromPosterior(("E_0", "E_1"), theta)
    target = build(STUDY, "voigt_kelvin_2", UNCERTAIN, [creep()], inherited)
    z = rng.standard_normal((np.prod(SIZE), target.dimension))
    table = summary(file(target, z, np.zeros(len(z))))
    assert (table.loc[["E_0", "E_1"], "prior_sensitivity"] > SENSITIVE).all()
    assert (table.loc[["E_0", "E_1"], "likelihood_sensitivity"] < 1e-4).all()


def test_data_on_one_parameter_move_that_one(target: LogPosterior) -> None:
    """Of E_0's z they say y with precision 99: its posterior is N(4, 0.1^2)."""
    k = target.names.index("E_0")
    z = np.random.default_rng(7).standard_normal((np.prod(SIZE), target.dimension))
    z[:, k] = 4.0 + 0.1 * z[:, k]
    table = summary(file(target, z, -0.5 * 99.0 * (400.0 / 99.0 - z[:, k]) ** 2))
    assert table.loc["E_0", "likelihood_sensitivity"] > 2 * SENSITIVE
    assert table.loc["E_0", "prior_sensitivity"] > SENSITIVE
    contraction = table["contraction"][list(target.names)]
    assert contraction["E_0"] == pytest.approx(0.99, abs=1e-3)
    assert contraction.drop("E_0").abs().max() < 0.15
    others = table.drop(index="E_0").loc[[n for n in target.names if n != "E_0"]]
    assert (others["likelihood_sensitivity"] < 0.03).all()


def test_draws_that_were_thinned_away_do_not_count(target: LogPosterior) -> None:
    """A log-likelihood that has nothing to do with the draws and varies much."""
    rng = np.random.default_rng(9)
    z = rng.standard_normal((np.prod(SIZE), target.dimension))
    table = summary(file(target, z, 20.0 * rng.standard_normal(len(z)), effective=1e9))
    assert table["likelihood_sensitivity"].isna().mean() > 0.8
    assert table.loc[list(target.names), "prior_sensitivity"].notna().all()


def test_files_without_the_columns_open(tmp_path, target: LogPosterior) -> None:
    z = np.random.default_rng(8).standard_normal((np.prod(SIZE), target.dimension))
    tree = file(target, z, np.zeros(len(z)))
    tree["summary"] = xr.DataTree(tree["summary"].to_dataset().drop_vars(COLUMNS))
    write_tree(tree, tmp_path / "posterior.nc")
    opened = deabayes.open_posterior(tmp_path / "posterior.nc")
    assert opened.converged
    assert not set(COLUMNS) & set(opened.summary().columns)
