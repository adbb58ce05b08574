"""Priors for PyMC and NumPyro: the files run, and define the normal of the posterior's draws."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from tests.shared.cards import posterior

from deabayes.export import export
from deabayes.export.priors import prior_normal
from deabayes.faults import UserError
from deabayes.posteriors.storage import stacked
from deabayes.prior.learned import distance_from_normal

PROGRAMS = ("pymc", "numpyro")
DRAWN = "deabayes_transformed"


def module(name, **content):
    found = ModuleType(name)
    found.__dict__.update(content)
    return found


@pytest.fixture
def made(monkeypatch):
    """What stand-ins for PyMC and NumPyro were asked to define: name -> what."""
    asked = {}

    def normal(name, mu, chol, shape):
        asked[name] = (mu, chol)
        assert shape == len(mu)
        return np.asarray(mu)

    def sample(name, distribution):
        asked[name] = (distribution.loc, distribution.scale_tril)
        return np.asarray(distribution.loc)

    def deterministic(name, value):
        asked[name] = value
        return value

    multivariate = SimpleNamespace(MultivariateNormal=lambda **given: SimpleNamespace(**given))
    stands = [
        module("pymc", MvNormal=normal, Deterministic=deterministic, math=np),
        module("numpyro", sample=sample, deterministic=deterministic, distributions=multivariate),
        module("jax"),
        module("jax.numpy", exp=np.exp),
    ]
    stands[2].numpy = stands[3]
    for stand in stands:
        monkeypatch.setitem(sys.modules, stand.__name__, stand)
    return asked


def run(tree, program, folder):
    export(tree, program, folder / "prior.py")
    known = {}
    exec(compile((folder / "prior.py").read_text("utf-8"), "prior.py", "exec"), known)
    return known


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_prior_is_the_normal_of_the_draws(program, made, tmp_path):
    tree = posterior("tensile_strip", "ogden_2_units_1", size=400)
    tree["posterior"]["mu_2"].values[:] *= tree["posterior"]["mu_beta_1"].values / 20e3
    tree["posterior"]["mu_1"].values[:] *= -1.0  # an exponent may be negative, with its modulus
    tree["posterior"]["alpha_1"].values[:] -= 12.0
    known = run(tree, program, tmp_path)
    names = ["mu_1", "mu_2", "alpha_1", "alpha_2", "mu_beta_1", "tau_1"]
    assert list(known["UNITS"]) == names
    assert list(known["UNITS"].values()) == ["Pa", "Pa", "1", "1", "Pa", "s"]
    assert known["LOGARITHM"] == ["mu_2", "alpha_2", "mu_beta_1", "tau_1"]
    values = np.column_stack([stacked(tree["posterior"], name) for name in names])
    values[:, [1, 3, 4, 5]] = np.log(values[:, [1, 3, 4, 5]])
    theta = known["prior"]()
    mean, factor = made[DRAWN]
    np.testing.assert_allclose(mean, values.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(
        factor @ factor.T, np.cov(values, rowvar=False), rtol=1e-9, atol=1e-12
    )
    assert np.array_equal(factor, np.tril(factor)) and factor[4, 1] > 0.05
    wanted = np.where([n in known["LOGARITHM"] for n in names], np.exp(mean), mean)
    assert list(theta) == names and np.allclose(list(theta.values()), wanted)
    assert all(made[name] == theta[name] for name in names)


def drawn_by(program, prior):
    """Draws of the parameters by the program itself, name -> (4000,)."""
    if program == "pymc":
        import pymc

        with pymc.Model():
            theta = prior()
            values = pymc.draw(list(theta.values()), draws=4000, random_seed=1)
        return dict(zip(theta, values, strict=True))
    import jax
    from numpyro.infer import Predictive

    return Predictive(prior, num_samples=4000)(jax.random.key(1))


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_program_itself_draws_from_the_posteriors_normal(program, tmp_path):
    """Where PyMC or NumPyro is installed; the environment of the tests has neither."""
    pytest.importorskip(program)
    known = run(posterior("tensile_strip", "ogden_2_units_1", size=400), program, tmp_path)
    drawn = drawn_by(program, known["prior"])
    values = np.column_stack(
        [
            np.log(drawn[name]) if name in known["LOGARITHM"] else drawn[name]
            for name in known["UNITS"]
        ]
    )
    scores = np.linalg.solve(known["CHOLESKY"], (values - known["MEAN"]).T)
    np.testing.assert_allclose(scores.mean(axis=1), 0.0, atol=5.0 / np.sqrt(4000))
    np.testing.assert_allclose(np.cov(scores), np.eye(len(scores)), atol=0.1)


def test_noise_and_derived_quantities_are_left_out(made, tmp_path):
    tree = posterior("membrane", "kv_gm_1", size=50)
    for name, kind in (("step.sigma_white", "noise"), ("t_v_1", "derived")):
        tree["posterior"][name] = tree["posterior"]["mu_alpha"].copy()
        tree["posterior"][name].attrs |= {"kind": kind}
    known = run(tree, "pymc", tmp_path)
    assert list(known["UNITS"]) == [
        "mu_alpha", "zeta_alpha", "J_alpha", "mu_beta_1", "tau_beta_1", "J_beta"]  # fmt: skip


def test_the_misfit_is_that_of_inherited_priors(made, tmp_path):
    tree = posterior("membrane", "kv_gm_1", size=2000)
    good = run(tree, "pymc", tmp_path)
    assert good["MISFIT"] < 0.03 and "the normal describes the posterior" in good["__doc__"]
    values = np.log(tree["posterior"]["J_beta"].values)
    tree["posterior"]["J_beta"].values[:] = np.exp(values + 1.5 * (values > np.median(values)))
    forked = run(tree, "pymc", tmp_path)
    logs = np.log(np.column_stack([stacked(tree["posterior"], n) for n in forked["UNITS"]]))
    white = np.linalg.solve(forked["CHOLESKY"], (logs - forked["MEAN"]).T).T
    assert forked["MISFIT"] == pytest.approx(distance_from_normal(white), rel=1e-3)
    assert forked["MISFIT"] > 0.15
    assert "above 0.05: the normal only approximates the posterior" in forked["__doc__"]


def test_an_order_that_the_normal_does_not_keep_is_described(made, tmp_path):
    tree = posterior("tubular", "voigt_kelvin_2", size=500)
    assert "holds in" not in run(tree, "numpyro", tmp_path)["__doc__"]
    first, second = (tree["posterior"][name].values for name in ("tau_1", "tau_2"))
    gaps = np.exp(np.abs(np.random.default_rng(0).normal(0.0, 0.5, first.shape)))
    second[:] = first * gaps
    known = run(tree, "numpyro", tmp_path)
    assert "tau_1 < tau_2 holds in the posterior, but not in" in known["__doc__"]
    ((names, share),) = prior_normal(tree).out_of_order.items()
    logs = np.log(gaps)
    from scipy.special import ndtr

    assert names == ("tau_1", "tau_2")
    assert share == pytest.approx(ndtr(-logs.mean() / logs.std()), rel=0.05)


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_docstring_names_candidate_provenance_and_convergence(program, made, tmp_path):
    tree = posterior("tubular", "circuit", size=50, converged=False)
    said = run(tree, program, tmp_path)["__doc__"]
    assert "circuit of system tubular, specimen tube, by deabayes 0.1.0" in said
    assert "SIMULATED" in said
    assert "NOT CONVERGED" in said
    fine = run(posterior("membrane", "kv_gm_1"), program, tmp_path)["__doc__"]
    assert "Provenance: measured." in fine and "CONVERGED" not in fine


def test_draws_that_define_no_normal_are_refused(tmp_path):
    few = posterior("membrane", "kv_gm_1", size=20)
    with pytest.raises(UserError, match=r"has 40 draws, .* 6 corr.* needs at least 60; fit again"):
        export(few, "pymc", tmp_path / "prior.py")
    fixed = posterior("membrane", "kv_gm_1")
    fixed["posterior"]["J_beta"].values[:] = 60.0
    with pytest.raises(UserError, match="all draws of J_beta are equal"):
        export(fixed, "pymc", tmp_path / "prior.py")
    group = fixed["posterior"]
    group["J_beta"].values[:] = group["J_alpha"].values ** 2
    with pytest.raises(UserError, match="J_beta follows from the others"):
        export(fixed, "pymc", tmp_path / "prior.py")
    with pytest.raises(UserError, match=r"-o .*prior\.json: --to pymc writes \.py"):
        export(posterior("membrane", "kv_gm_1"), "pymc", tmp_path / "prior.json")
    assert not list(tmp_path.iterdir())


def test_terms_keep_their_signs(made, tmp_path):
    """mu_i alpha_i > 0: logarithms where both are positive, and told where both may be negative."""
    tree = posterior("tensile_strip", "ogden_2", size=500)
    assert prior_normal(tree).logarithm[:4] == (True,) * 4
    assert "same sign" not in run(tree, "pymc", tmp_path)["__doc__"]
    rng, shape = np.random.default_rng(0), tree["posterior"]["mu_1"].shape
    turned = np.where(rng.random(shape) < 0.5, -1.0, 1.0)
    for name in ("mu_1", "alpha_1"):
        tree["posterior"][name].values[:] *= turned
    normal = prior_normal(tree)
    assert dict(zip(normal.names, normal.logarithm, strict=True)) == {
        "mu_1": False, "alpha_1": False, "mu_2": True, "alpha_2": True,
    }  # fmt: skip
    ((pair, share),) = normal.opposed.items()
    drawn = normal.mean + rng.standard_normal((40_000, 4)) @ normal.factor.T
    first, second = (drawn[:, normal.names.index(name)] for name in pair)
    assert set(pair) == {"mu_1", "alpha_1"}
    assert share == pytest.approx(np.mean(first * second < 0.0), abs=0.01) and share > 0.01
    assert "mu_1 and alpha_1 have the same sign in" in run(tree, "pymc", tmp_path)["__doc__"]
