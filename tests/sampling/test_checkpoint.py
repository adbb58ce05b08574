"""Checkpoints: whole or absent, in order, and enough to go on from."""

import zipfile

import numpy as np
import pytest

from deabayes.sampling.checkpoint import (
    Store,
    random_state_arrays,
    random_state_from,
    read_arrays,
    write_arrays,
)


def test_arrays_come_back_and_no_partial_file_stays(tmp_path):
    write_arrays(tmp_path / "a" / "x.npz", {"x": np.arange(3.0)})
    assert read_arrays(tmp_path / "a" / "x.npz")["x"].tolist() == [0, 1, 2]
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["x.npz"]


def test_damaged_and_partial_files_count_as_missing(tmp_path):
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


def test_a_stored_random_state_continues_its_stream(tmp_path):
    random = np.random.RandomState(3)
    random.randn(7)
    write_arrays(tmp_path / "r.npz", random_state_arrays(random.get_state()))
    other = np.random.RandomState()
    other.set_state(random_state_from(read_arrays(tmp_path / "r.npz")))
    assert other.randn(5).tobytes() == random.randn(5).tobytes()


def test_a_damaged_header_counts_as_a_missing_file(tmp_path):
    """A turned bit may leave brackets open, on which numpy's parser raises an error of its own."""
    header = b"{'descr': ('<f8', 'fortran_order': False, 'shape': (3,), }".ljust(117) + b"\n"
    content = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(24)
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("x.npy", content)
    assert read_arrays(tmp_path / "x.npz") is None
