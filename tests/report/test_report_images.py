"""Embedded figures keep the colours that legends explain, and stay small."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from deabayes.figures import style
from deabayes.report.page import QUALITIES, shrink


def picture() -> Image.Image:
    """Patches of all colours a legend may have, and lines that blend them with white."""
    colours = [*style.SERIES, *(colour for colour, _ in style.BANDS.values()), "#a6d3ee"]
    canvas = np.full((700, 2161, 3), 255.0)
    for k, colour in enumerate(colours):
        value = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
        canvas[20:60, 20 + 110 * k : 110 + 110 * k] = value
        shares = np.linspace(0.0, 1.0, 200)[:, None]
        canvas[100 + 40 * k : 102 + 40 * k, 20:220] = shares * value + (1.0 - shares) * 255.0
    return Image.fromarray(canvas.round().astype(np.uint8))


@pytest.mark.parametrize(("width", "colours"), QUALITIES)
def test_areas_keep_their_colours(tmp_path: Path, width: int, colours: int) -> None:
    original = picture()
    original.save(path := tmp_path / "figure.png")
    data, size = shrink(path, width, colours)
    assert size == original.size and len(data) < 20_000
    (small := tmp_path / "small.png").write_bytes(data)
    with Image.open(small) as opened:
        found = np.asarray(opened.convert("RGB")).astype(int)
        assert len(opened.getcolors()) <= colours
    factor = found.shape[1] / original.size[0]
    for k in range(12):
        x, y = 65 + 110 * k, 40
        shown, meant = found[round(factor * y), round(factor * x)], original.getpixel((x, y))
        assert np.abs(shown - np.array(meant)).max() <= 6, (k, shown, meant)
