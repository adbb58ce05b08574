"""Sampling a posterior: `engine.sample` takes a `problem.Problem` to draws and a verdict on them.

All is in z, where the prior is N(0, I). Nothing here knows a model: coordinates that straighten
ridges, and hops between modes, come with the problem.
"""
