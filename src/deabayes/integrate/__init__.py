"""Numerical integrators that do not depend on any model."""
