"""A posterior as a prior for PyMC: a Python module with the numbers in it."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from deabayes.export.prior_normal import write_python

IMPORTS = "import numpy as np\nimport pymc as pm"
PRIOR = '''\
def prior():
    """Define the parameters inside a model (`with pm.Model(): theta = prior()`).

    Returns a dictionary, name -> variable, SI.
    """
    drawn = pm.MvNormal("deabayes_transformed", mu=MEAN, chol=CHOLESKY, shape=len(UNITS))
    return {
        name: pm.Deterministic(name, pm.math.exp(drawn[k]) if name in LOGARITHM else drawn[k])
        for k, name in enumerate(UNITS)
    }
'''


def write(tree: xr.DataTree, path: Path) -> None:
    """`prior()` of the material and specimen parameters; see `prior_normal`.

    Raises
    ------
    UserError : too few draws, or draws without spread.
    """
    write_python(tree, path, "PyMC", IMPORTS, PRIOR)
