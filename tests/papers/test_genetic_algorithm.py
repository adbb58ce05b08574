"""The paper's fit by a genetic algorithm, beside the posterior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.shared.structure_contexts import STATIC, motion, static, truth
from tests.shared.structures import FILM, structure

from deabayes.papers.minimum_energy_structure import genetic_algorithm


@pytest.fixture(scope="module")
def few():
    """Two short runs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(genetic_algorithm, "SEEDS", (1, 2))
        patch.setattr(genetic_algorithm, "GENERATIONS", 150)
        yield


@pytest.fixture(scope="module")
def analysis(few):
    return genetic_algorithm.compute(static())


def records():
    return [e for e in static().experiments if e.role == "calibrate"]


def test_the_fitness_is_the_mean_square_of_the_forces():
    fitness = genetic_algorithm.mean_square(structure("ogden_4"), records(), list(FILM))
    there = np.array(list(FILM.values()))
    raised = there * np.where(np.array(list(FILM)) == "relative_permittivity", 1.1, 1.0)
    found = fitness(np.stack([there, raised], axis=1))
    assert found[0] < 1e-24
    driven = records()[1].excitation
    more = truth("ogden_4", driven, driven.coordinate, "force")
    changed = structure("ogden_4").predict(
        driven,
        driven.coordinate,
        "force",
        {n: np.array([v]) for n, v in zip(FILM, raised, strict=True)},
    )[0]
    assert found[1] == pytest.approx(0.5 * np.mean((changed - more) ** 2))
    # Without a term the hinges would have to push: no film.
    assert fitness(np.where(there == there, 0.0, there)[:, None])[0] > 1.0


def test_bounds_are_the_papers():
    assert genetic_algorithm.bounds_of("mu_3") == (1e3, 1e6)
    assert genetic_algorithm.bounds_of("alpha_1") == (0.0, 5.0)
    assert genetic_algorithm.bounds_of("relative_permittivity") == (0.0, 5.0)
    assert genetic_algorithm.bounds_of("rest_angle") is None


def test_terms_are_put_in_order():
    given = {"mu_1": 1.0, "mu_2": 2.0, "alpha_1": 3.0, "alpha_2": 0.5, "relative_permittivity": 2.0}
    found = genetic_algorithm.ascending(given)
    assert found == {"mu_1": 2.0, "mu_2": 1.0, "alpha_1": 0.5, "alpha_2": 3.0,
                     "relative_permittivity": 2.0}  # fmt: skip


def test_runs_fit_and_are_placed_in_the_posterior(analysis):
    runs = analysis.tables["genetic_algorithm_runs"]
    assert list(runs["candidate"]) == ["ogden_1", "ogden_1", "ogden_4", "ogden_4"]
    np.testing.assert_allclose(runs["relative_permittivity"], FILM["relative_permittivity"],
                               rtol=0.03)  # fmt: skip
    assert np.all(runs["rms_mN"] < 8.0) and runs["rms_mN"].min() < 0.2
    draws = static().candidates["ogden_1"].draws["relative_permittivity"]
    below = 100.0 * np.mean(draws < runs["relative_permittivity"][0])
    assert runs["relative_permittivity_below_percent"][0] == pytest.approx(below)
    terms = analysis.tables["genetic_algorithm_terms"]
    assert terms["mu_kPa"].between(1.0, 1000.0).all() and terms["alpha"].between(0.0, 5.0).all()
    total = terms.groupby(["candidate", "seed"])["share_kPa"].sum()
    np.testing.assert_allclose(total, runs["mu_0_kPa"])
    curve = analysis.curves["ogden_4"]
    assert curve["draw_share"].sizes == {"term": 4, "draw": 20}
    np.testing.assert_allclose(curve["run_mu_0"], 1e3 * runs["mu_0_kPa"][2:])
    assert np.all(np.diff(curve["run_alpha"], axis=0) >= 0.0)


def test_the_same_seed_finds_the_same(few):
    once, again = (
        genetic_algorithm.optimum(structure("ogden_1"), records(), 1) for _ in range(2)
    )  # fmt: skip
    assert once == again


def test_without_forces_or_with_units_there_are_no_runs(few, analysis):
    assert not genetic_algorithm.compute(motion()).tables
    forces = [e for e in static().experiments if e.role == "validate"]
    assert not genetic_algorithm.compute(replace(static(), experiments=forces)).tables
    moving = replace(static(), candidates=motion().candidates)
    assert not genetic_algorithm.compute(moving).tables
    assert set(STATIC) == set(analysis.curves)
