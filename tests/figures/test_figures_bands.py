"""The predictive band is seen where the band with discrepancy fills it, and legends say as what."""

import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from deabayes.figures import bands, style

X = np.linspace(0.0, 1.0, 20)


def test_edges_of_the_predictive_band_lie_on_the_one_that_fills_it() -> None:
    ends = dict.fromkeys(style.BANDS, (-1.0 - 0 * X, 1.0 + X))
    ax = Figure().subplots()
    bands.fill(ax, X, ends)
    for line, edge in zip(ax.lines, ends["predictive"], strict=True):
        np.testing.assert_array_equal(line.get_ydata(), edge)
        assert line.get_zorder() > max(each.get_zorder() for each in ax.collections)
        assert to_hex(line.get_color()) not in [colour for colour, _ in style.BANDS.values()]


def test_the_legend_shows_the_edge_of_the_predictive_band_alone() -> None:
    entries = {handle.get_label(): handle for handle in bands.handles()[2:]}
    for name, (colour, label) in style.BANDS.items():
        patch = entries[label]
        assert to_hex(patch.get_facecolor()) == to_hex(colour)
        outlined = to_hex(patch.get_edgecolor()) == style.GREY
        assert outlined == (name == "predictive")
