"""Public data: where they are looked for, what is said when they are missing, fetching."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from tests.shared.study_folders import make_folder, record_lines

from deabayes.faults import Faults, UserError
from deabayes.records import record
from deabayes.records.download import fetch, missing_data, read_registry
from deabayes.records.folder import read_folder
from deabayes.records.table import read_table


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A study folder whose records are public data that are not there."""
    monkeypatch.delenv("DEABAYES_DATA", raising=False)
    monkeypatch.setattr(record, "cache_folder", lambda: tmp_path / "cache")
    made = make_folder(tmp_path)
    (made / "records").rename(tmp_path / "published")
    digests = {
        f"records/{p.name}": hashlib.sha256(p.read_bytes()).hexdigest()
        for p in (tmp_path / "published").iterdir()
    }
    lines = [f"{name} {digest}\n" for name, digest in digests.items()]
    (made / "registry.txt").write_text("# path sha256\n" + "".join(lines))
    base = (tmp_path / "served").as_uri()
    with (made / "specimen.yaml").open("a") as stream:
        stream.write(f"download: {{folder: set, base_url: '{base}', registry: registry.txt}}\n")
    return made


def publish(folder: Path, place: str) -> Path:
    """Put the records where they are expected."""
    target = folder.parent / place
    target.mkdir(parents=True)
    (folder.parent / "published").rename(target / "records")
    return target


def test_missing_data_is_one_sentence_with_the_remedy(folder: Path) -> None:
    sentence = missing_data(folder)
    assert sentence is not None
    for word in ("2 of 2", "make data", "DEABAYES_DATA", "set/"):
        assert word in sentence
    with pytest.raises(Faults) as caught:
        read_folder(folder)
    assert list(caught.value.faults) == [sentence]


def test_a_variable_that_names_no_copy_is_said(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DEABAYES_DATA", "/typo")
    assert "holds set/ (now it is /typo, which does not)" in (missing_data(folder) or "")


@pytest.mark.parametrize("how", ["variable", "data_root", "study folder", "cache"])
def test_places_where_records_are_found(
    folder: Path, how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = {"variable": "local/set", "data_root": "local/set", "study folder": "strip/"}
    if how == "study folder":
        (folder.parent / "published").rename(folder / "records")
        target = folder
    else:
        target = publish(folder, places.get(how, "cache/set"))
    if how == "variable":
        monkeypatch.setenv("DEABAYES_DATA", str(folder.parent / "local"))
    root = folder.parent / "local" if how == "data_root" else None
    assert missing_data(folder, root) is None
    read = read_folder(folder, root)
    assert read.locate(read.table[0]) == target / "records" / "relax.csv"
    assert read.warnings(read.table[0]) == []
    if how != "cache":
        assert fetch(folder, root) == target


def test_the_variable_wins_over_the_config(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = publish(folder, "local/set")
    other = folder.parent / "other" / "set" / "records"
    other.mkdir(parents=True)
    (other / "relax.csv").write_text("wrong")
    monkeypatch.setenv("DEABAYES_DATA", str(folder.parent / "local"))
    read = read_folder(folder, folder.parent / "other")
    assert read.locate(read.table[0]) == target / "records" / "relax.csv"


def test_a_changed_file_is_warned_of(folder: Path) -> None:
    target = publish(folder, "local/set")
    path = target / "records" / "relax.csv"
    path.write_text("\n".join(record_lines(3)) + "\n")
    read = read_folder(folder, folder.parent / "local")
    assert "differs from the published file" in read.warnings(read.table[0])[0]


def test_own_records_need_no_download(tmp_path: Path) -> None:
    own = make_folder(tmp_path)
    assert missing_data(own) is None
    assert fetch(own) == own


def test_registry_lines(tmp_path: Path) -> None:
    path = tmp_path / "registry.txt"
    path.write_text(f"a b/c d.csv {'0' * 64}\ne.csv {'A1' * 32} their own/e 1.csv\n")
    assert read_registry(path) == {
        "a b/c d.csv": ("0" * 64, "a b/c d.csv"),
        "e.csv": ("a1" * 32, "their own/e 1.csv"),
    }
    for wrong in ("a.csv 123", f"a.csv {'0' * 63}", f"{'0' * 64}", f"a.csv {'0' * 65}"):
        path.write_text(f"# path sha256\n{wrong}\n")
        with pytest.raises(UserError, match=r"registry\.txt, line 2: expected 'path sha256'"):
            read_registry(path)


def test_a_record_is_fetched_from_its_path_at_the_source(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import pooch

    registry = folder / "registry.txt"
    lines = registry.read_text().splitlines()
    moved = [f"{line} their data/{Path(line.split()[0]).name}" for line in lines[1:]]
    registry.write_text("\n".join([lines[0], *moved]) + "\n")
    asked = []

    def copy(url: str, output: str, pooch: object, **settings: object) -> None:
        asked.append(url)
        name = url.rpartition("/")[2]
        Path(output).write_bytes((folder.parent / "published" / name).read_bytes())

    monkeypatch.setattr(pooch.core, "choose_downloader", lambda *a, **k: copy)
    assert fetch(folder) == folder.parent / "cache" / "set"
    assert all("/served/their%20data/" in url for url in asked)
    assert len(asked) == 2
    assert missing_data(folder) is None


def test_the_shipped_registries_name_every_record() -> None:
    data = Path(__file__).resolve().parents[2] / "data"
    for path in data.glob("*/registry.txt"):
        rows = {row.record for row in read_table(path.parent)}
        assert rows <= set(read_registry(path)), path


def test_fetch_without_network_says_so(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import pooch

    def fail(self: object, record: str, **settings: object) -> str:
        raise ConnectionError("no route")

    monkeypatch.setattr(pooch.Pooch, "fetch", fail)
    with pytest.raises(UserError, match=r"cannot be downloaded \(ConnectionError\).*DEABAYES_DATA"):
        fetch(folder)


def test_fetch_checks_what_it_fetched(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import pooch

    source = folder.parent / "published"

    def copy(url: str, output: str, pooch: object, **settings: object) -> None:
        content = (source / url.rpartition("/")[2]).read_bytes()
        Path(output).write_bytes(content + (b"x" if spoiled else b""))

    monkeypatch.setattr(pooch.core, "choose_downloader", lambda *a, **k: copy)
    spoiled = True
    with pytest.raises(UserError, match="is not the file this project was made with"):
        fetch(folder)
    spoiled = False
    assert fetch(folder) == folder.parent / "cache" / "set"
    assert missing_data(folder) is None
