"""The page in a headless Chromium: errors, requests, sorting, zoom, narrow, wide and dark."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), ""
)
pytestmark = pytest.mark.skipif(not CHROMIUM, reason="no Chromium is installed")
WIDE, NARROW = {"width": 1400, "height": 900}, {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        yield started
        started.close()


@pytest.fixture
def visit(browser: Any, built: tuple[str, Path]) -> Iterator[Any]:
    """Open the page; after the test, check that nothing was requested and no error occurred."""
    faults: list[str] = []
    contexts = []
    address = built[1].with_name("index.html").as_uri()

    def note_request(request: Any) -> None:
        if not request.url.startswith((address, "data:", "blob:")):
            faults.append(f"request of {request.url}")

    def open_page(size: dict[str, int] = WIDE, scheme: str = "light") -> Any:
        context = browser.new_context(viewport=size, color_scheme=scheme)
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("console", lambda m: faults.append(m.text) if m.type in ("error", "warning") else 0)
        page.on("request", note_request)
        page.goto(address)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert faults == []


def in_view(page: Any, selector: str) -> bool:
    box = page.locator(selector).first.bounding_box()
    size = page.viewport_size
    return (
        0 <= box["y"] < size["height"] and 0 <= box["x"] < box["x"] + box["width"] <= size["width"]
    )


@pytest.mark.parametrize("size", [WIDE, NARROW])
def test_the_first_screen_has_the_verdict_and_five_numbers(visit: Any, size: Any) -> None:
    page = visit(size)
    assert page.locator("#card-fake_strip").is_visible()
    assert in_view(page, ".choice") and page.locator(".choice").first.inner_text() == "Use kv_gm_2"
    assert page.locator(".card").first.locator("table:not(.errors) tr").count() == 5
    assert in_view(page, ".card table:not(.errors) tr:nth-child(5) .number")


@pytest.mark.parametrize("size", [WIDE, NARROW])
def test_nothing_needs_scrolling_sideways(visit: Any, size: Any) -> None:
    page = visit(size)
    page.evaluate("document.querySelectorAll('details').forEach(fold => { fold.open = true; })")
    page.wait_for_selector("[data-state=shown]")
    assert page.evaluate("document.documentElement.scrollWidth") == size["width"]
    if size == NARROW:
        assert page.evaluate(
            "[...document.querySelectorAll('.scroll')].every(s => s.scrollWidth <= s.clientWidth)"
        )
        label = "getComputedStyle(document.querySelector('.scroll td.number'), '::before').content"
        assert page.evaluate(label) == '"Median [5 %, 95 %]"'


@pytest.mark.parametrize("size", [WIDE, NARROW])
def test_contents_stay_and_lead_to_the_parts(visit: Any, size: Any) -> None:
    page = visit(size)
    if size == NARROW:
        page.locator("nav label").click()
    page.locator("nav a", has_text="fake_tube").click()
    page.wait_for_selector("nav li.current a[href='#fake_tube']", state="attached")
    assert page.evaluate("scrollY") > 1000
    assert in_view(page, "nav label" if size == NARROW else "nav a[href='#overview']")
    assert not page.locator("#menu").is_checked()
    if size == WIDE:
        page.locator("nav a[href='#fake_tube-parameters']").click()
        assert in_view(page, "#fake_tube-parameters")


def test_tables_sort_by_numbers_with_their_units(visit: Any) -> None:
    page = visit()
    table = page.locator("#fake_strip table.sortable").first
    units = {"µm": 1e-6, "mm": 1e-3, "ms": 1e-3, "kPa": 1e3, "kPa·s": 1e3}

    def medians() -> list[float]:
        cells = table.locator("tbody").first.locator("tr td:nth-child(2)").all_inner_texts()
        return [float(c.split()[0]) * units.get(c.split()[-1], 1.0) for c in cells]

    before = medians()
    head = table.locator("th", has_text="Median")
    head.click()
    assert medians() == sorted(before) != before
    head.press("Enter")
    assert medians() == sorted(before, reverse=True)
    assert table.locator("tbody tr.kind").first.inner_text() == "Material"
    numbers = page.evaluate(
        "['−5 [−6, −4]', '1.5×10⁻³', '20.0 µm', '3 kPa', '7 m', '12 %', '–'].map(number)"
    )
    assert numbers == pytest.approx([-5.0, 1.5e-3, 2e-5, 3e3, 7.0, 12.0, -float("inf")])


def test_a_sheet_is_enlarged_twice_and_closed(visit: Any) -> None:
    page = visit()
    page.locator("a.sheet img").first.click()
    enlarged = page.locator("#zoom img")
    assert enlarged.is_visible() and page.locator("#zoom").bounding_box()["width"] == 1400
    enlarged.click()
    assert enlarged.bounding_box()["width"] > 2 * 1400
    page.keyboard.press("Escape")
    assert not enlarged.is_visible() and page.url.endswith("index.html")


def test_interactive_figures_are_made_when_opened_and_zoom_together(visit: Any) -> None:
    page = visit()
    assert page.evaluate("typeof Bokeh") == "undefined"
    page.locator("#fake_strip-predictions + details summary").click()
    page.wait_for_selector(".live[data-state=shown]")
    assert page.evaluate("typeof Bokeh") == "object"
    place = page.locator(".live").first
    records = place.locator("option").all_inner_texts()
    assert len(records) == 2 and all("(calibration)" in text for text in records)
    figure = "Bokeh.documents.at(-1)"
    curves = f"{figure}.get_model_by_name('curves').data"
    place.locator("select").select_option(index=1)
    page.wait_for_function(f"{curves}.x.length > 100")
    label = page.evaluate(f"{figure}.get_model_by_name('label0').axis_label")
    assert label.startswith("time ") and label.endswith(" (s)")
    rest = f"(d => d.observed[7] - d.median[7] - d.residual[7])({curves})"
    assert page.evaluate(rest) == pytest.approx(0.0)
    ends = f"[...{figure}._all_models.values()].filter(m => m.x_range).map(m => m.x_range.end)"
    before = page.evaluate(ends)
    assert len(before) == 2
    box = place.locator(".plot").bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 400, box["y"] + 200, steps=5)
    page.mouse.up()
    page.wait_for_function(f"{ends}[0] < {before[0]}")
    after = page.evaluate(ends)
    assert after[0] == after[1] < before[0]


def test_figures_are_dark_where_the_reader_prefers_it(visit: Any) -> None:
    def colours(scheme: str) -> tuple[str, str]:
        page = visit(scheme=scheme)
        style = "getComputedStyle(document.querySelector('%s')).%s"
        return tuple(
            page.evaluate(style % pair)
            for pair in (("body", "backgroundColor"), ("figure img", "filter"))
        )

    assert colours("light") == ("rgb(255, 255, 255)", "none")
    assert colours("dark") == ("rgb(26, 26, 26)", "invert(0.9) hue-rotate(180deg)")
