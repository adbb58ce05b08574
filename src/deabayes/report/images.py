"""Figures as they are embedded in the page: small enough for a mail attachment."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from pathlib import Path

from deabayes.figures import SavedFigure

QUALITIES = ((1300, 96), (1000, 64), (800, 32))
"""Width in pixels and colours, tried in turn until the page is small enough."""


@dataclass(frozen=True)
class Image:
    """An embedded sheet; `width` and `height` in CSS pixels keep the page from jumping."""

    source: str
    width: int
    height: int
    text: str


def embed(figure: SavedFigure, width: int, colours: int) -> Image:
    """The PNG of a saved sheet, scaled down and with few colours, as a data URI."""
    data, size = shrink(figure.png, width, colours)
    scale = 900 / 1441
    return Image(
        "data:image/png;base64," + base64.b64encode(data).decode("ascii"),
        round(size[0] * scale),
        round(size[1] * scale),
        " ".join(filter(None, (figure.title, figure.candidate))),
    )


def shrink(path: Path, width: int, colours: int) -> tuple[bytes, tuple[int, int]]:
    """PNG bytes at most `width` pixels wide with a palette, and the original's size.

    A figure holds few colours, so a palette costs nothing visible and saves
    two thirds.
    """
    from PIL import Image as Picture

    with Picture.open(path) as opened:
        picture, size = opened.convert("RGB"), opened.size
    factor = min(width / 1441, 1.0)
    if factor < 1.0:
        smaller = (round(size[0] * factor), round(size[1] * factor))
        picture = picture.resize(smaller, Picture.Resampling.LANCZOS)
    picture = picture.quantize(colours, Picture.Quantize.MAXCOVERAGE, dither=Picture.Dither.NONE)
    buffer = io.BytesIO()
    picture.save(buffer, format="PNG", optimize=True)
    return buffer.getvalue(), size
