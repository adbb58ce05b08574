"""What a posterior hands on to a study of the same specimen, and to one of another."""

import dataclasses
import json

import numpy as np
import pytest
import xarray as xr
from tests.shared.fake_tables import whole

from deabayes.experiment import Quantity, Specimen
from deabayes.faults import UserError
from deabayes.posteriors.content import _notes, _with_doubts, at_the_rim
from deabayes.posteriors.inheritance import inherit_from
from deabayes.posteriors.storage import specimen_to_json, write_tree
from deabayes.prior.distributions import Normal
from deabayes.prior.joint import Prior
from deabayes.prior.parameter import Parameter

KINDS = {"mu_alpha": "material", "cross_section": "specimen", "permittivity": "specimen",
         "mu_0": "derived"}  # fmt: skip


def strip(name="a", area=1e-5, permittivity=4.1e-11):
    quantities = {
        "cross_section": Quantity(area, "m^2", 1e-7),
        "permittivity": Quantity(permittivity, "F/m", 2e-12),
    }
    return Specimen(name, "tensile_strip", {"kind": "measured"}, quantities)


@pytest.fixture
def stored(tmp_path):
    def store(converged=True, kinds=KINDS, **more):
        rng = np.random.default_rng(1)
        draws = {
            name: (("chain", "draw"), np.exp(rng.normal(size=(2, 50))), {"kind": kind})
            for name, kind in kinds.items()
        }
        tree = xr.DataTree.from_dict({"posterior": xr.Dataset(draws)})
        tree.attrs.update(
            specimen=specimen_to_json(strip()),
            convergence=json.dumps({"converged": converged}),
            study=json.dumps({"priors": {"mu_alpha": {"distribution": "normal"}}}),
            **more,
        )
        path = tmp_path / "posterior.nc"
        write_tree(whole(tree), path)
        return path

    return store


def test_the_same_specimen_takes_over_all_but_what_is_derived(stored):
    found = inherit_from(stored(), strip())
    assert found.prior.names == ("mu_alpha", "cross_section", "permittivity")
    assert found.prior.draws.shape == (100, 3)
    assert found.same_specimen and found.priors == {"mu_alpha": {"distribution": "normal"}}
    assert not found.notes and not found.doubts


@pytest.mark.parametrize("other", [strip("b"), strip("a", area=1.1e-5)])
def test_another_specimen_keeps_its_own_geometry(stored, other):
    found = inherit_from(stored(), other)
    assert found.prior.names == ("mu_alpha", "permittivity")
    assert not found.same_specimen
    assert found.notes[0].startswith("prior_from: cross_section of a do not apply to")


def test_a_material_property_stated_otherwise_is_not_taken_over(stored):
    found = inherit_from(stored(), strip("b", permittivity=5e-11))
    assert found.prior.names == ("mu_alpha",)


def test_a_populations_posterior_describes_a_new_specimen(stored):
    found = inherit_from(stored(population="{}"), strip("c", area=2e-5))
    assert found.prior.names == ("mu_alpha", "cross_section", "permittivity")
    assert not found.same_specimen and not found.notes


def test_a_prior_that_did_not_converge_is_a_doubt(stored):
    path = stored(converged=False)
    (doubt,) = inherit_from(path, strip()).doubts
    assert str(path) in doubt and "did not converge" in doubt


def test_a_prior_of_another_system_is_noted(stored):
    assert not inherit_from(stored(), strip("a")).notes
    tube = dataclasses.replace(strip("b"), system="tubular")
    (note,) = (n for n in inherit_from(stored(), tube).notes if "another system" in n)
    assert "(tensile_strip, here tubular)" in note


def test_a_posterior_does_not_converge_if_its_prior_did_not(stored):
    doubted = inherit_from(stored(converged=False), strip())
    passed = {"converged": True, "reasons": []}
    assert _with_doubts(passed, None) == passed
    assert _with_doubts(passed, inherit_from(stored(), strip())) == passed
    found = _with_doubts(passed, doubted)
    assert not found["converged"] and "did not converge" in found["reasons"][0]


def test_a_prior_that_does_not_describe_the_draws_is_said_to_be_approximate(stored):
    prior = Prior([Parameter("x", "x", "1", "", Normal(0.0, 1.0), "")])
    rng = np.random.default_rng(1)
    draws = rng.normal(size=(4000, 1))
    assert not _notes(prior.inherit(("x",), draws), None)
    modes = 0.3 * draws + rng.choice([-1, 1], (4000, 1))
    assert not _notes(prior.inherit(("x",), modes), None)
    apart = _notes(prior.inherit(("x",), modes[:19]), None)  # too few for a mixture
    assert "approximate" in apart[0]
    notes = inherit_from(stored(), strip("b")).notes
    assert _notes(prior, inherit_from(stored(), strip("b"))) == list(notes)


@pytest.mark.parametrize(("shift", "said"), [(0.0, False), (1.5, False), (4.0, True)])
def test_records_that_contradict_the_inherited_prior_are_warned_of(shift, said):
    rng = np.random.default_rng(2)
    own = [Parameter(n, n, "1", "", Normal(0.0, 1.0), "") for n in "abc"]
    prior = Prior(own).inherit(("a", "b"), 0.3 * rng.normal(size=(4000, 2)))
    theta = 0.05 * rng.normal(size=(500, 3)) + [0.3 * shift, 0.0, 3.0]
    found = at_the_rim(prior, theta)
    assert bool(found) is said
    if said:
        assert "pull a, b to the edge of the other posterior" in found[0]
    assert not at_the_rim(Prior(own), theta)


def test_a_posterior_without_material_parameters_is_no_prior(stored):
    path = stored(kinds={"cross_section": "specimen"})
    with pytest.raises(UserError, match="holds no parameter"):
        inherit_from(path, strip("b"))


def test_specimens_with_other_sources_of_quantities_are_the_same(stored):
    own = strip()
    renamed = {n: dataclasses.replace(q, source="calliper") for n, q in own.quantities.items()}
    assert inherit_from(stored(), dataclasses.replace(own, quantities=renamed)).same_specimen
