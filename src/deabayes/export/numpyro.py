"""A posterior as a prior for NumPyro: a Python module with the numbers in it."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from deabayes.export.prior_normal import write_python

IMPORTS = (
    "import jax.numpy as jnp\nimport numpy as np\nimport numpyro\nfrom numpyro import distributions"
)
PRIOR = '''\
def prior():
    """Define the parameters inside a model (`theta = prior()`).

    Returns a dictionary, name -> value, SI. `numpyro.enable_x64()` first keeps all digits.
    """
    normal = distributions.MultivariateNormal(loc=MEAN, scale_tril=CHOLESKY)
    drawn = numpyro.sample("deabayes_transformed", normal)
    return {
        name: numpyro.deterministic(name, jnp.exp(drawn[k]) if name in LOGARITHM else drawn[k])
        for k, name in enumerate(UNITS)
    }
'''


def write(tree: xr.DataTree, path: Path) -> None:
    """`prior()` of the material and specimen parameters; see `prior_normal`.

    Raises
    ------
    UserError : too few draws, or draws without spread.
    """
    write_python(tree, path, "NumPyro", IMPORTS, PRIOR)
