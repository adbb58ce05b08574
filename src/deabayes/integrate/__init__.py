"""Numerical integrators; they know no model."""
