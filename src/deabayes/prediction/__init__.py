"""Predictions of a fitted candidate: bands, extrapolation warnings, and prediction errors."""
