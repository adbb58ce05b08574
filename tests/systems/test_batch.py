import numpy as np
import pytest
from tests.validation.membrane_worlds import membrane
from tests.validation.tubular_worlds import tubular_full

from deabayes.systems.base import Batch, cached


def test_a_result_is_computed_once_for_a_batch_and_each_time_otherwise():
    for draws, expected in ((Batch({"a": np.ones(2)}), 1), ({"a": np.ones(2)}, 3)):
        computed = []
        for _ in range(3):
            cached(draws, "sum", lambda computed=computed: computed.append(1))
        assert len(computed) == expected


def test_another_key_is_another_thing():
    batch = Batch({"a": np.ones(2)})
    assert [cached(batch, key, lambda key=key: key) for key in ("x", "y", "x")] == ["x", "y", "x"]


def test_a_batch_stays_as_it_is_and_what_is_derived_from_it_is_none():
    given = {"a": np.ones(2)}
    batch = Batch(given)
    cached(batch, "sum", lambda: 2.0)
    given["a"] = np.zeros(2)
    assert np.array_equal(batch["a"], np.ones(2))
    for change in ("__setitem__", "update", "pop", "setdefault", "clear"):
        assert not hasattr(batch, change)
    changed = {**batch, "a": np.zeros(2)}
    assert cached(changed, "sum", lambda: "anew") == "anew"


@pytest.mark.parametrize("world", [membrane(), tubular_full()], ids=["membrane", "tubular"])
def test_records_answer_a_batch_as_they_answer_its_draws(world):
    """And two systems do not take each other's."""
    one, two = world.target(1), world.target(1)
    z = 0.3 * np.random.default_rng(1).standard_normal((5, one.dimension))
    theta = one.prior.to_parameters(z)
    batch = one.draws(theta)
    assert isinstance(batch, Batch)
    for mine, other in zip(one.records, two.records, strict=True):
        wanted = mine.simulate(dict(batch))
        assert np.array_equal(mine.simulate(batch), wanted)
        assert np.array_equal(other.simulate(batch), wanted)
    assert len(batch.results) > 2
