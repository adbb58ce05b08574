"""Shrink the figures and embed them in the page."""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from PIL import ImageColor

from deabayes.figures import SavedFigure
from deabayes.figures.style import BANDS, SERIES

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

QUALITIES = ((1300, 96), (1000, 64), (800, 32))
"""Width in pixels and number of colours, tried in turn until the page is small enough."""
DOUBLE_COLUMN = 2161
"""Width in pixels of a double-column figure at 300 dpi."""
SHOWN = 900
"""Width in CSS pixels of a double-column figure on the page."""
SAMPLED = 3
"""Step in pixels, in both directions, of the samples from which rarer colours are found."""
WHITE = 250
"""Channels from this value on become 255: the nearest colour of the palette may miss white."""
STYLE = [
    ImageColor.getrgb(colour) for colour in (*SERIES, *(colour for colour, _ in BANDS.values()))
]
"""Colours of the figures, which thin lines must keep."""
LARGEST = 11_500_000
"""Largest size of all sheets in bytes; mail servers often refuse more than 20 MB encoded."""
TRIED, FAR_TOO_LARGE = 8, 1.4
"""Every `TRIED`-th sheet is scaled first, to estimate the size of all sheets. The others are
skipped if the estimate exceeds `FAR_TOO_LARGE` times `LARGEST`."""
THREADS = 2
"""Threads that scale sheets; nothing else runs while the report is made."""


@dataclass(frozen=True)
class Image:
    """An embedded sheet; `width` and `height` in CSS pixels reserve its space on the page.

    `links` are kinds of files (SVG, PDF) and their addresses from the page.
    """

    source: str
    width: int
    height: int
    text: str
    links: tuple[tuple[str, str], ...]


def embed_all(figures: Sequence[SavedFigure], page: Path) -> dict[Path, Image]:
    """Return the embedded sheets of a page by PNG path, in the best quality that fits.

    All together have at most `LARGEST` bytes.
    """
    images: list[Image] = []
    with ThreadPoolExecutor(THREADS) as pool:
        for width, colours in QUALITIES:
            embedded = partial(embed, page=page, width=width, colours=colours)
            estimate = TRIED * _size(pool.map(embedded, figures[::TRIED]))
            if estimate > FAR_TOO_LARGE * LARGEST and (width, colours) != QUALITIES[-1]:
                continue
            images = list(pool.map(embedded, figures))
            if _size(images) <= LARGEST:
                break
    return {figure.png: image for figure, image in zip(figures, images, strict=True)}


def _size(images: Iterable[Image]) -> int:
    return sum(len(image.source) for image in images)


def address(path: Path, page: Path) -> str:
    """Address of a file from the folder of the page."""
    return quote(Path(os.path.relpath(path.resolve(), page.resolve().parent)).as_posix())


def embed(figure: SavedFigure, page: Path, width: int, colours: int) -> Image:
    """Embed the PNG of a saved sheet as a data URI, scaled down and with few colours."""
    data, size = shrink(figure.png, width, colours)
    scale = SHOWN / DOUBLE_COLUMN
    files = {"SVG": figure.svg, "PDF": figure.svg.with_suffix(".pdf"), "PNG": figure.png}
    links = tuple((kind, address(file, page)) for kind, file in files.items() if file.is_file())
    return Image(
        "data:image/webp;base64," + base64.b64encode(data).decode("ascii"),
        round(size[0] * scale),
        round(size[1] * scale),
        " ".join(filter(None, (figure.title, figure.candidate))),
        links,
    )


def shrink(path: Path, width: int, colours: int) -> tuple[bytes, tuple[int, int]]:
    """Return the bytes of a smaller WebP of few colours, and the size of the original.

    A double-column figure becomes at most `width` pixels wide. A figure has few colours, so a
    palette costs nothing visible and saves two thirds. The palette holds the exact colours of
    areas, so that areas and legend agree.
    """
    from PIL import Image as Pictures

    with Pictures.open(path) as opened:
        picture, size = opened.convert("RGB"), opened.size
    factor = min(width / DOUBLE_COLUMN, 1.0)
    if factor < 1.0:
        smaller = (round(size[0] * factor), round(size[1] * factor))
        picture = picture.resize(smaller, Pictures.Resampling.HAMMING)
    picture = picture.quantize(palette=_palette(picture, colours), dither=Pictures.Dither.NONE)
    buffer = io.BytesIO()
    picture = picture.convert("RGB").point(lambda value: 255 if value >= WHITE else value)
    # Without loss, a WebP is a fifth smaller than a PNG.
    picture.save(buffer, format="WEBP", lossless=True, quality=50)
    return buffer.getvalue(), size


def _palette(picture: Picture, colours: int) -> Picture:
    """Palette of the style's colours, the most frequent ones (half), and medians of all colours."""
    from PIL import Image as Pictures

    counted: list[Any] = picture.getcolors(picture.width * picture.height) or []
    frequent = [colour for _, colour in sorted(counted, reverse=True)[: colours // 2]]
    exact = list(dict.fromkeys(frequent + STYLE))
    left = colours - len(exact)
    size = (-(-picture.width // SAMPLED), -(-picture.height // SAMPLED))
    sampled = picture.resize(size, Pictures.Resampling.NEAREST)
    medians = sampled.quantize(left, Pictures.Quantize.MEDIANCUT).getpalette() or []
    palette = Pictures.new("P", (1, 1))
    palette.putpalette([channel for colour in exact for channel in colour] + medians[: 3 * left])
    return palette
