"""Figures as they are embedded in the page: small enough for a mail attachment."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deabayes.figures import SavedFigure

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

QUALITIES = ((1300, 96), (1000, 64), (800, 32))
"""Width in pixels and colours, tried in turn until the page is small enough."""
DOUBLE_COLUMN = 2161
"""Pixels of a figure as wide as two columns of a journal, at 300 dpi."""
SAMPLED = 3
"""Every so many pixels either way are looked at for the rarer colours."""
LARGEST = 13_000_000
"""Bytes of all sheets: mail servers commonly refuse more than 20 MB after their own encoding."""
TRIED, FAR_TOO_LARGE = 8, 1.4
"""Every so many sheets are scaled to see whether all would fit; and the factor of `LARGEST` beyond
which the others are not."""
THREADS = 2
"""Nothing else runs when the report is made."""


@dataclass(frozen=True)
class Image:
    """An embedded sheet; `width` and `height` in CSS pixels keep the page from jumping."""

    source: str
    width: int
    height: int
    text: str


def embed_all(figures: Sequence[SavedFigure]) -> dict[Path, Image]:
    """All sheets by their PNG, as well as they can be within `LARGEST`."""
    images: list[Image] = []
    with ThreadPoolExecutor(THREADS) as pool:
        for width, colours in QUALITIES:
            embedded = partial(embed, width=width, colours=colours)
            tried = TRIED * _size(pool.map(embedded, figures[::TRIED]))
            if tried > FAR_TOO_LARGE * LARGEST and (width, colours) != QUALITIES[-1]:
                continue
            images = list(pool.map(embedded, figures))
            if _size(images) <= LARGEST:
                break
    return {figure.png: image for figure, image in zip(figures, images, strict=True)}


def _size(images: Iterable[Image]) -> int:
    return sum(len(image.source) for image in images)


def embed(figure: SavedFigure, width: int, colours: int) -> Image:
    """The PNG of a saved sheet, scaled down and with few colours, as a data URI."""
    data, size = shrink(figure.png, width, colours)
    scale = 900 / DOUBLE_COLUMN
    return Image(
        "data:image/png;base64," + base64.b64encode(data).decode("ascii"),
        round(size[0] * scale),
        round(size[1] * scale),
        " ".join(filter(None, (figure.title, figure.candidate))),
    )


def shrink(path: Path, width: int, colours: int) -> tuple[bytes, tuple[int, int]]:
    """PNG bytes at most `width` pixels wide with a palette, and the original's size.

    A figure holds few colours, so a palette costs nothing visible and saves
    two thirds. Those of areas are in it as they are: a legend must not take another one.
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
    picture.save(buffer, format="PNG")
    return buffer.getvalue(), size


def _palette(picture: Picture, colours: int) -> Picture:
    """The most frequent colours, half as many as there may be, and medians of all."""
    from PIL import Image as Pictures

    counted = picture.getcolors(picture.width * picture.height) or []
    frequent = sorted(counted, reverse=True)[: colours // 2]
    left = colours - len(frequent)
    size = (-(-picture.width // SAMPLED), -(-picture.height // SAMPLED))
    sampled = picture.resize(size, Pictures.Resampling.NEAREST)
    medians = sampled.quantize(left, Pictures.Quantize.MEDIANCUT).getpalette() or []
    palette = Pictures.new("P", (1, 1))
    areas = np.array([colour for _, colour in frequent]).ravel().tolist()
    palette.putpalette(areas + medians[: 3 * left])
    return palette
