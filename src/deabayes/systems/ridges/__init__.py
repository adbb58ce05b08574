"""Coordinates in which ridges of relaxation units, springs and terms are straight, and hops."""
