"""Sample a posterior: `engine.sample` turns a `problem.Problem` into draws and a verdict.

All draws are in z, where the prior is N(0, I). This package knows no model. The problem brings the
coordinates that straighten ridges, and the hops between modes.
"""
