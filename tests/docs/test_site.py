"""The pages as `make docs` builds them: search without a server, the interface, their length."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import deabayes

ROOT = Path(__file__).parents[2]
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome") or ""
CELL = re.compile(r"<td>(.*?)</td>", re.DOTALL)
LIMIT = 25_000  # words of all pages, the README and the notebooks' text, without code


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    mkdocs = Path(sys.executable).with_name("mkdocs")
    build = [mkdocs, "build", "--strict", "--quiet", "--config-file", ROOT / "mkdocs.yml"]
    run = subprocess.run([*build, "--site-dir", folder], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return folder


@pytest.mark.skipif(not CHROMIUM, reason="needs Chromium")
@pytest.mark.parametrize("page", ["index.html", "reference/words.html"])
def test_search_works_from_the_file_system(site: Path, page: str) -> None:
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=10000"]
    shown = [CHROMIUM, *options, "--dump-dom", f"{(site / page).as_uri()}?q=pull-in"]
    run = subprocess.run(shown, capture_output=True, text=True, timeout=120)
    found = re.findall(r'<a[^>]*href="([^"]+)"[^>]*class="md-search-result__link"', run.stdout)
    assert any(link.startswith((site / "theory/membrane.html").as_uri()) for link in found), found


def test_nothing_is_fetched_from_a_network(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text("utf-8")
        fetched = re.findall(r"<(?:script|img|iframe)[^>]* src=\"?(https?:[^\s\">]+)", text)
        fetched += re.findall(r"<link[^>]* rel=\"?stylesheet[^>]* href=\"?(https?:[^\s\">]+)", text)
        assert fetched == [], page


def test_the_interface_is_listed_with_types(site: Path) -> None:
    page = (site / "reference/python.html").read_text("utf-8")
    offered = [name for name in dir(deabayes) if not name.startswith("_")]
    assert offered == sorted(deabayes.__all__)
    for name in offered:
        assert f'id="deabayes.{name}"' in page
    members = [deabayes.Posterior.draws, deabayes.Posterior.predict, deabayes.simulate]
    members += [deabayes.open_posterior, deabayes.load_models]
    hints = {re.sub(r"\s", "", str(h)) for m in members for h in m.__annotations__.values()}
    tables = re.findall(r"Parameters:.*?</table>", page, re.DOTALL)
    assert len(tables) == len(members)
    for row in re.findall(r"<tr\b.*?</tr>", "".join(tables), re.DOTALL):
        cells = [html.unescape(re.sub(r"<[^>]*>|\s", "", cell)) for cell in CELL.findall(row)]
        assert not cells or cells[1] in hints, cells


def test_every_notebook_is_a_page_with_its_outputs(site: Path) -> None:
    notebooks = sorted((ROOT / "docs/notebooks").glob("*.ipynb"))
    assert len(notebooks) == 6
    start = (site / "index.html").read_text("utf-8")
    for notebook in notebooks:
        cells = json.loads(notebook.read_text("utf-8"))["cells"]
        outputs = [output for cell in cells for output in cell.get("outputs", [])]
        page = (site / f"notebooks/{notebook.stem}.html").read_text("utf-8")
        pictures = [output for output in outputs if "image/png" in output.get("data", {})]
        assert page.count(f'src="{notebook.stem}_') == len(pictures)
        texts = [output for output in outputs if output["output_type"] == "stream"]
        assert texts and all("".join(output["text"]).split()[0] in page for output in texts)
        assert f"notebooks/{notebook.stem}.html" in start


def test_the_pages_stay_short() -> None:
    texts = [path.read_text("utf-8") for path in [*ROOT.glob("docs/**/*.md"), ROOT / "README.md"]]
    for path in ROOT.glob("docs/notebooks/*.ipynb"):
        cells = json.loads(path.read_text("utf-8"))["cells"]
        texts += ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown"]
    fence = re.compile(r"^ *```.*?^ *```$", re.DOTALL | re.MULTILINE)
    assert sum(len(fence.sub("", text).split()) for text in texts) <= LIMIT
