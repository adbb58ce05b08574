"""Minimum-energy structure in a posterior: its prior, its datum, its derived quantities."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.shared.structures import (
    PLAIN,
    paper_draws,
    pull,
    sine,
    specimen,
    spread_draws,
    structure,
)

from deabayes.experiment import Experiment, Quantity
from deabayes.inference.log_posterior import build
from deabayes.pipeline import fit
from deabayes.posteriors.inheritance import Inheritance
from deabayes.prediction.simulate import simulate
from deabayes.prior.from_posterior import PriorFromPosterior
from deabayes.prior.joint import Prior
from deabayes.study import Study
from deabayes.systems.minimum_energy_structure.system import CHUNK

HINGE = Quantity(0.026, "N*m/rad", 0.001)


def force_record():
    displacement = np.linspace(0.0, 0.01, 12)
    driven = pull(displacement, 4e3)
    force = structure("ogden_4").predict(driven, displacement, "force", paper_draws())[0]
    return Experiment(
        "quasi_static_4kV", "quasi_static", "calibrate", "displacement", "m", displacement,
        "force", "N", force, np.ones(12), driven,
    )  # fmt: skip


def test_a_measured_hinge_is_in_the_likelihood():
    study = Study("s", Path(), ("ogden_1",))
    record = force_record()
    plain = build(study, "ogden_1", PLAIN, [record])
    measured = build(study, "ogden_1", specimen(hinge_stiffness=HINGE), [record])
    theta = plain.prior.sample(np.random.default_rng(0), 20)
    stiffness = plain.system.derived(plain.draws(theta))["hinge_stiffness"].values
    expected = -0.5 * ((stiffness - 0.026) / 0.001) ** 2 - np.log(0.001 * np.sqrt(2.0 * np.pi))
    without = plain.log_likelihood(theta)
    assert np.isfinite(without).sum() > 5
    difference = measured.log_likelihood(theta) - without
    kept = np.isfinite(difference)
    assert difference[kept] == pytest.approx(expected[kept], rel=1e-6)
    alone = measured.log_likelihood(theta, [record.name])
    assert alone[kept] == pytest.approx(without[kept]), "the hinge is no part of a record"


def test_what_the_prior_of_the_same_specimen_knows_of_the_hinge_counts_once(monkeypatch):
    """The posterior of a first study has the datum in it: as a prior it must not meet it again."""
    record, own = force_record(), specimen(hinge_stiffness=HINGE)
    study = Study("s", Path(), ("ogden_1",), prior_from=Path("first/posterior.nc"))
    draws = build(study, "ogden_1", own, [record]).prior.sample(np.random.default_rng(0), 200)
    first = PriorFromPosterior(("mu_1", "alpha_1", "relative_permittivity"), draws[:, :3])
    monkeypatch.setattr(fit, "calibrated_files", lambda *_: [Path("force.nc")])
    monkeypatch.setattr(fit, "read_prepared", lambda path: record)
    monkeypatch.setattr("deabayes.records.specimen.read_specimen", lambda path: own)
    found = {}
    for same in (True, False):
        monkeypatch.setattr(fit, "inherited_prior", lambda *_, s=same: Inheritance(first, s))
        found[same] = fit.build_target(study, "ogden_1", Path())
    theta = draws[:20]
    once, twice = (found[same].log_likelihood(theta) for same in (True, False))
    np.testing.assert_allclose(once, found[True].log_likelihood(theta, [record.name]))
    kept = np.isfinite(once)
    assert kept.sum() > 5 and np.all(np.abs(twice - once)[kept] > 0.1)


def motion_record():
    time, driven = np.linspace(0.0, 2.0, 200), sine(5.0, 10, per_period=200)
    exact = structure("ogden_4_units_4", 1e-9).predict(driven, time, "displacement", paper_draws())
    return Experiment(
        "sine_5kV_5Hz", "sine", "calibrate", "time", "s", time,
        "displacement", "m", exact[0], np.ones(200), driven,
    )  # fmt: skip


def test_the_solver_of_a_likelihood_is_looser_and_moves_it_by_hundredths():
    record = motion_record()
    study = Study("s", Path(), ("ogden_4_units_4",))
    found = build(study, "ogden_4_units_4", PLAIN, [record])
    solved = structure("ogden_4_units_4", 1e-9)
    simulate_well = solved.simulator(record.excitation, record.coordinate, "displacement")
    exact = replace(found, records=(replace(found.records[0], simulate=simulate_well),))
    draws = spread_draws(4, 40, sd=0.003)
    size = np.ptp(record.response)
    noise = {"sigma_white": 1e-3 * size, "sigma_ou": 1e-3, "tau_ou": 0.02}
    draws |= {f"sine.{name}": np.full(40, value) for name, value in noise.items()}
    theta = np.stack([draws[name] for name in found.names], axis=1)
    difference = found.log_likelihood(theta) - exact.log_likelihood(theta)
    assert 0.0 < np.std(difference) < 0.01
    assert np.abs(difference).max() < 0.03
    rougher = found.rough().log_likelihood(theta) - exact.log_likelihood(theta)
    assert np.std(difference) < np.std(rougher) < 0.5
    assert found.system.tolerance == 1e-6, "predictions are solved as well as before"
    assert solved.for_likelihood() is solved
    assert replace(found, system=solved).rough().records is found.records


def test_the_prior_is_that_of_the_film_s_stress_at_rest():
    system = structure("ogden_3")
    prior = Prior.from_parameters(system.parameters())
    assert prior.scored_alone == {"relative_permittivity"}
    theta = prior.sample(np.random.default_rng(1), 3000)
    draws = dict(zip(prior.names, theta.T, strict=True))
    stress = system.structure(draws).film(np.array([np.cos(np.pi / 4)]))[:, 0] / (1.5e-3 * 4e-5)
    assert np.mean(np.log(stress / 1e6)) == pytest.approx(0.0, abs=0.06)
    assert np.std(np.log(stress)) == pytest.approx(1.0, abs=0.05)


def test_derived_quantities_of_many_draws_come_in_their_order():
    count = CHUNK + 7
    draws = spread_draws(1, count)
    system = structure("ogden_4_units_1")
    last = {name: values[-3:] for name, values in draws.items()}
    for name, each in system.derived(draws).items():
        assert each.values.shape == (count,)
        assert each.values[-3:] == pytest.approx(system.derived(last)[name].values)


def test_free_displacement_beyond_the_branch_is_that_at_its_end():
    draws = paper_draws(relative_permittivity=3.4)
    system = structure("ogden_4")
    found = {name: each.values[0] for name, each in system.derived(draws).items()}
    assert found["snap_voltage"] < 5e3
    assert np.isnan(system.structure(draws).equilibrium(5e3)[0])
    angle = system.structure(draws).branch[0][0, -1]
    assert found["free_displacement_5kV"] == pytest.approx(0.067 * (np.cos(angle) - np.sqrt(0.5)))


def test_a_response_that_is_not_named_is_the_one_that_goes_with_the_excitation():
    time = np.linspace(0.0, 0.2, 21)
    parameters = {name: values[0] for name, values in paper_draws(1).items()}
    quantities = {n: q.value for n, q in PLAIN.quantities.items()}
    asked = {"parameters": parameters, "specimen": quantities}
    moving = simulate(
        "minimum_energy_structure", "ogden_4_units_1", **asked, time=time, voltage=0 * time + 3e3
    )
    assert moving.displacement[-1] > 1e-4
    del parameters["k_1"], parameters["tau_1"], parameters["eta_0"]
    held = simulate(
        "minimum_energy_structure", "ogden_4", **asked, displacement=np.linspace(0.0, 0.01, 5),
        conditions={"voltage": 5e3},
    )  # fmt: skip
    assert held.force[0] == pytest.approx(0.149279371, rel=1e-8)
