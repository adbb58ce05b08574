"""Files appear complete or not at all."""

from __future__ import annotations

import errno
import subprocess
import sys
from pathlib import Path

import pytest

from deabayes.files import write_atomically, write_text_atomically


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("old")

    def fail(place: Path) -> None:
        place.write_text("half")
        raise RuntimeError("killed")

    with pytest.raises(RuntimeError, match="killed"):
        write_atomically(fail, path)
    assert [p.name for p in tmp_path.iterdir()] == ["table.csv"]
    assert path.read_text() == "old"


def test_a_folder_in_its_place_is_named_as_the_user_did(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError, match="is a folder, name a file") as caught:
        write_text_atomically("text", tmp_path)
    assert caught.value.filename == str(tmp_path)
    assert not list(tmp_path.parent.glob(".*.tmp"))


@pytest.mark.parametrize("filename", ["of the temporary file", None], ids=["named", "in text"])
def test_where_nothing_can_be_written_the_file_is_named_as_the_user_did(
    tmp_path: Path, filename: str | None
) -> None:
    def refuse(place: Path) -> None:
        raise PermissionError(13, f"name = '{place}'", filename and str(place))

    with pytest.raises(PermissionError, match=r"cannot be written \(Permission denied") as caught:
        write_atomically(refuse, tmp_path / "table.csv")
    assert caught.value.filename == str(tmp_path / "table.csv")


def test_another_file_that_fails_meanwhile_keeps_its_name(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="not_there"):
        write_atomically(lambda _: (tmp_path / "not_there").read_text(), tmp_path / "table.csv")


def test_the_file_is_not_there_before_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / "table.csv"

    def write(place: Path) -> None:
        place.write_text("first")
        assert not path.exists()
        assert place.parent == path.parent

    write_atomically(write, path)
    assert path.read_text() == "first"
    write_text_atomically("λ\n", path)
    assert path.read_bytes() == "λ\n".encode()


def test_the_first_error_is_reported_if_the_temporary_file_cannot_be_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read_only(place: Path, missing_ok: bool = False) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(place))

    monkeypatch.setattr(Path, "unlink", read_only)
    with pytest.raises(OSError, match="cannot be written") as caught:
        write_atomically(read_only, tmp_path / "table.csv")
    assert caught.value.filename == str(tmp_path / "table.csv")


FULL = """
import resource
from pathlib import Path

import numpy as np
import xarray as xr

from deabayes.cli.main import cli, main
from deabayes.posteriors.storage import write_tree

draws = xr.Dataset({"E_0": (("chain", "draw"), np.ones((4, 20_000)))})


@cli.command()
def fill():
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))
    write_tree(xr.DataTree.from_dict({"posterior": draws}), Path("results/posterior.nc"))


main(["fill"])
"""


def test_a_full_disk_is_reported_with_the_file(tmp_path: Path) -> None:
    """HDF5 ended Python with a segmentation fault."""
    pytest.importorskip("resource")
    ended = subprocess.run([sys.executable, "-c", FULL], cwd=tmp_path, capture_output=True)
    told = ended.stderr.decode()
    assert ended.returncode == 1, told
    said = "deabayes: results/posterior.nc: cannot be written (File too large); make room\n"
    assert told == said
    assert not list((tmp_path / "results").iterdir())
