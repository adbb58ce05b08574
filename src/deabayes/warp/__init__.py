"""Smooth maps fitted to draws, in which a bent ridge is straight."""

from __future__ import annotations

from deabayes.warp.polynomial import Warp, fit_warp

__all__ = ["Warp", "fit_warp"]
