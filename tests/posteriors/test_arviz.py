"""Posterior files in ArviZ: 0.x, and the packages that ArviZ 1.x puts together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tests.posteriors.test_predict_with import UNCERTAIN, creep
from tests.systems.test_tubular_frequency_response import draws as true_draws

from deabayes.api import Posterior, open_posterior
from deabayes.comparison.blocks import leave_one_block_out
from deabayes.inference.log_posterior import build
from deabayes.posteriors.content import PosteriorContent
from deabayes.posteriors.file import POSTERIOR_PREDICTIVE_DRAWS, posterior_tree
from deabayes.posteriors.storage import sum_of_draws, write_tree
from deabayes.study import Study

STUDY = Study("creep", Path("data/tubular"), ("voigt_kelvin_2",), noise="ornstein_uhlenbeck")
SHAPE = (4, 500)
MATERIAL = ["E_0", "tau_1"]
BLOCKS = 14


def fitted():
    """Two noisy records of the tube."""
    rng = np.random.default_rng(5)
    first = creep()
    records = [
        replace(first, name=name, response=first.response + 1e-4 * rng.standard_normal(40))
        for name in ("creep", "again")
    ]
    return build(STUDY, "voigt_kelvin_2", UNCERTAIN, records)


def posterior(target):
    """The file's content for draws close to the truth."""
    truth = {name: value[0] for name, value in true_draws().items()}
    truth |= {"creep.sigma_white": 1e-4, "creep.sigma_ou": 0.01, "creep.tau_ou": 5e-3}
    truth |= {name: q.value for name, q in UNCERTAIN.quantities.items()}
    centre = target.prior.to_normal(np.array([[truth[name] for name in target.names]]))
    z = centre + 0.002 * np.random.default_rng(1).standard_normal((*SHAPE, target.dimension))
    derived = target.system.derived(target.draws(target.prior.to_parameters(z[0, :2])))
    columns = "mean sd median q05 q95 mcse_mean ess_bulk ess_tail r_hat".split()
    table = pd.DataFrame(1.0, index=[*target.names, *derived], columns=columns)
    return posterior_tree(
        PosteriorContent(
            STUDY, "voigt_kelvin_2", UNCERTAIN, target, z, np.zeros(SHAPE), table,
            {"converged": True, "reasons": []}, [], np.random.SeedSequence(3),
        )
    )  # fmt: skip


@pytest.fixture(scope="module")
def target():
    return fitted()


@pytest.fixture(scope="module")
def tree(target):
    return posterior(target)


@pytest.fixture(scope="module")
def path(tree, tmp_path_factory):
    place = tmp_path_factory.mktemp("arviz") / "posterior.nc"
    write_tree(tree, place)
    return place


@pytest.fixture(autouse=True)
def no_window():
    """Figures without a screen, and closed afterwards."""
    from matplotlib import pyplot

    with mpl.rc_context():
        pyplot.switch_backend("Agg")
        yield
        pyplot.close("all")


def titles():
    """Texts of all axes of all open figures."""
    from matplotlib import pyplot

    return {
        text
        for number in pyplot.get_fignums()
        for axes in pyplot.figure(number).axes
        for text in (axes.get_title(), axes.get_xlabel(), axes.get_ylabel())
    }


def check(loaded, summary, loo, tree):
    """Summary of every quantity, and the elpd that the package itself finds for the blocks."""
    assert list(summary.index) == list(tree["posterior"].data_vars)
    means = [float(drawn.mean()) for drawn in tree["posterior"].data_vars.values()]
    np.testing.assert_allclose(summary["mean"].astype(float), means, rtol=1e-12)
    terms = tree["log_likelihood"]["blocks"]
    own = leave_one_block_out(terms.values.reshape(-1, terms.sizes["block"]).astype(float))
    assert loo.n_data_points == own.terms.size == BLOCKS
    assert loo.n_samples == np.prod(SHAPE)
    np.testing.assert_allclose(loo.pareto_k, own.k_hat, atol=0.1)
    assert set(loaded["posterior_predictive"].data_vars) == {"creep", "again"}


@pytest.mark.filterwarnings("ignore:\\s*ArviZ is undergoing:FutureWarning")
@pytest.mark.filterwarnings("ignore:Passing a dict or None as alias_mapping")
def test_the_last_arviz_before_1_reads_the_file(path, tree):
    import arviz

    assert arviz.__version__.startswith("0.")
    loaded = arviz.from_netcdf(str(path))
    loo = arviz.loo(loaded, pointwise=True)
    check(loaded, arviz.summary(loaded, round_to="none"), loo, tree)
    terms = tree["log_likelihood"]["blocks"].values.reshape(-1, BLOCKS).astype(float)
    assert loo.elpd_loo == pytest.approx(leave_one_block_out(terms).terms.sum(), abs=0.02)
    assert arviz.plot_trace(loaded, var_names=MATERIAL).shape == (2, 2)
    arviz.plot_pair(loaded, var_names=MATERIAL)
    assert {"E_0", "tau_1"} <= titles()
    axes = arviz.plot_ppc(loaded)
    assert len(np.ravel(axes)) == 2 and {"creep", "again"} <= titles()


def test_the_packages_of_arviz_1_read_the_file(path, tree):
    """`arviz` 1.x needs Python 3.12 and is a list of these names, `from_netcdf` that of xarray."""
    import arviz_plots
    import arviz_stats

    with xr.open_datatree(path) as loaded:
        loo = arviz_stats.loo(loaded, pointwise=True)
        check(loaded, arviz_stats.summary(loaded, round_to="none"), loo, tree)
        terms = tree["log_likelihood"]["blocks"].values.reshape(-1, BLOCKS).astype(float)
        assert loo.elpd == pytest.approx(leave_one_block_out(terms).terms.sum(), abs=0.02)
        for plot in (arviz_plots.plot_trace, arviz_plots.plot_pair):
            plot(loaded, var_names=MATERIAL, backend="matplotlib")
        assert {"E_0", "tau_1"} <= titles()
        arviz_plots.plot_ppc_dist(loaded, backend="matplotlib")
    assert {"creep", "again"} <= titles()


def test_blocks_of_a_record_add_up_to_its_log_likelihood(target, tree):
    terms = tree["log_likelihood"]["blocks"]
    by_record = terms.groupby("record").sum("block")
    columns = [tree["posterior"][name].values.reshape(-1) for name in target.names]
    theta = np.stack(columns, axis=1)
    for name in ("creep", "again"):
        got = by_record.sel(record=name).transpose("chain", "draw").values.reshape(-1)
        np.testing.assert_allclose(got, target.log_likelihood(theta, [name]), rtol=1e-6)
    labels = terms["block"].values.tolist()
    assert labels[0] == "the beginning of creep, time 0.001 to 0.0458 s"
    assert len(set(labels)) == BLOCKS and terms["record"].values.tolist() == ["creep"] * (
        BLOCKS // 2
    ) + ["again"] * (BLOCKS // 2)


def test_repetitions_are_the_curve_of_their_draw_and_all_noise(target, tree):
    repeated, chosen = tree["posterior_predictive"], tree["posterior"]
    at = {"chain": repeated["chain"], "draw": repeated["draw"]}
    theta = np.stack([chosen[name].sel(at).values.reshape(-1) for name in target.names], axis=1)
    assert len(theta) == POSTERIOR_PREDICTIVE_DRAWS
    assert repeated["draw"].values.tolist()[::24] == [0, SHAPE[1] - 1]
    draws = target.draws(theta)
    noises = []
    for record in target.records:
        name = record.experiment.name
        drawn = repeated[name]
        assert drawn.attrs["units"] == "1"
        assert drawn.dims[2] == tree["observed_data"][name].dims[0]
        residuals = drawn.values.reshape(100, -1) - record.simulate(draws)
        noise = target.noise_draws(draws, record)
        scores = target.noise.innovations(residuals, record.noise_coordinate, record.weights, noise)
        assert scores.mean() == pytest.approx(0.0, abs=4.0 / np.sqrt(scores.size))
        assert scores.std() == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * scores.size))
        noises.append(residuals)
    assert abs(np.corrcoef(noises[0].ravel(), noises[1].ravel())[0, 1]) < 0.06


def test_a_file_from_before_opens_and_predicts_the_same(tree, tmp_path):
    """It has no posterior predictive draws, and one log-likelihood per record."""
    groups = {
        name: child.to_dataset()
        for name, child in tree.children.items()
        if name != "posterior_predictive"
    }
    groups["log_likelihood"] = xr.Dataset({"creep": (("chain", "draw"), np.zeros(SHAPE))})
    old = xr.DataTree.from_dict(groups)
    old.attrs = tree.attrs
    write_tree(old, tmp_path / "posterior.nc")
    opened = open_posterior(tmp_path / "posterior.nc")
    asked = {"time": np.linspace(0.0, 0.5, 20), "voltage": 2000.0, "size": 50}
    xr.testing.assert_identical(
        opened.predict(**asked).drop_attrs(), Posterior(tree).predict(**asked).drop_attrs()
    )
    assert sum_of_draws(opened.data) == sum_of_draws(tree)
