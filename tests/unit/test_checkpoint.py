"""Checkpoints: whole or absent, in order, and enough to go on from."""

import zipfile

import numpy as np
import pytest
import xarray as xr

from deabayes.faults import UserError
from deabayes.sampling.checkpoint import (
    Store,
    random_state_arrays,
    random_state_from,
    read_arrays,
    write_arrays,
)
from deabayes.sampling.coordinates import Coordinates
from deabayes.sampling.ensemble import Ensemble, align
from deabayes.sampling.proposal_fit import fit


def test_arrays_come_back_and_no_partial_file_stays(tmp_path):
    write_arrays(tmp_path / "a" / "x.npz", {"x": np.arange(3.0)})
    assert read_arrays(tmp_path / "a" / "x.npz")["x"].tolist() == [0, 1, 2]
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["x.npz"]


def test_missing_damaged_and_partial_files_count_as_absent(tmp_path):
    write_arrays(tmp_path / "x.npz", {"x": np.arange(1000.0)})
    content = (tmp_path / "x.npz").read_bytes()
    for length in (0, 10, len(content) // 2, len(content) - 1):
        (tmp_path / "x.npz").write_bytes(content[:length])
        assert read_arrays(tmp_path / "x.npz") is None
    (tmp_path / ".y.npz.123.tmp").write_bytes(content)
    assert read_arrays(tmp_path / "y.npz") is None


def test_a_result_is_computed_once(tmp_path):
    def fail():
        pytest.fail("computed again")

    assert Store(tmp_path).once("mixture", lambda: {"x": np.ones(2)})["x"].sum() == 2
    assert Store(tmp_path).once("mixture", fail)["x"].sum() == 2


def test_a_damaged_chunk_ends_the_sequence_and_is_replaced(tmp_path):
    store = Store(tmp_path)
    for value in range(4):
        store.append({"x": np.full(10, value)})
    path = tmp_path / "chunk_00002.npz"
    path.write_bytes(path.read_bytes()[:50])
    again = Store(tmp_path)
    assert [int(chunk["x"][0]) for chunk in again.chunks()] == [0, 1]
    again.append({"x": np.full(10, 9)})
    assert [int(chunk["x"][0]) for chunk in again.chunks()] == [0, 1, 9]
    assert int(read_arrays(path)["x"][0]) == 9


def test_a_store_in_memory_keeps_its_chunks():
    store = Store(None)
    store.append({"x": np.ones(1)})
    assert len(store.chunks()) == 1


def test_random_state_goes_on_where_it_was(tmp_path):
    random = np.random.RandomState(3)
    random.randn(7)
    write_arrays(tmp_path / "r.npz", random_state_arrays(random.get_state()))
    other = np.random.RandomState()
    other.set_state(random_state_from(read_arrays(tmp_path / "r.npz")))
    assert other.randn(5).tobytes() == random.randn(5).tobytes()


def ensemble(steps):
    rng = np.random.default_rng(steps)
    chain = rng.standard_normal((steps, 4, 2))
    proposal = fit(chain.reshape(-1, 2), 2, rng)
    return Ensemble(chain, -chain[..., 0], proposal, 900, 300, 2, 0.3, 8.5, 1, 5000, 7, True)


def test_an_ensemble_comes_back_from_its_file(tmp_path):
    original = ensemble(30)
    original.write(tmp_path / "0.nc")
    back = Ensemble.read(tmp_path / "0.nc", Coordinates())
    assert back.chain.tobytes() == original.chain.tobytes()
    assert back.log_posterior.tobytes() == original.log_posterior.tobytes()
    z = original.chain[0]
    assert len(back.proposal.parts) == 2
    assert back.proposal.log_density(z).tobytes() == original.proposal.log_density(z).tobytes()
    scalars = ["steps", "burn_in", "acceptance", "failures", "enough", "refitted"]
    assert [getattr(back, name) for name in scalars] == [900, 300, 0.3, 7, True, False]
    assert [path.name for path in tmp_path.iterdir()] == ["0.nc"]


def test_runs_of_different_lengths_are_thinned_to_the_shortest():
    long, short = ensemble(100), ensemble(30)
    chain, log_posterior = align([long, short])
    assert chain.shape == (2, 30, 4, 2)
    assert chain[1].tobytes() == short.chain.tobytes()
    assert (chain[0, -1] == long.chain[-1]).all()
    assert (log_posterior == -chain[..., 0]).all()


@pytest.mark.parametrize("kind", ["a posterior", "no netCDF"])
def test_a_file_that_is_no_ensemble(tmp_path, kind):
    path = tmp_path / "posterior.nc"
    if kind == "a posterior":
        xr.Dataset({"E_0": 1.0}).to_netcdf(path, engine="h5netcdf")
    else:
        path.write_text("time [s]")
    with pytest.raises(UserError, match=r"posterior\.nc: is no ensemble's file.* --output"):
        Ensemble.read(path, Coordinates())


def test_a_header_that_is_no_header_any_more_counts_as_damaged(tmp_path):
    """A turned bit may leave brackets open, on which numpy's parser raises an error of its own."""
    header = b"{'descr': ('<f8', 'fortran_order': False, 'shape': (3,), }".ljust(117) + b"\n"
    content = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(24)
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("x.npy", content)
    assert read_arrays(tmp_path / "x.npz") is None
