"""Hops, and coordinates that straighten ridges of relaxation units, springs and spring terms."""
