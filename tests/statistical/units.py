"""Priors of relaxation units."""

from deabayes.prior.distributions import LogNormal, LogUniform
from deabayes.prior.joint import Prior
from deabayes.prior.parameter import Parameter


def chain_prior(units, own_prior=False, others=0):
    """Units of a modulus and a time constant, moduli with one prior or each its own; others."""
    moduli = [
        Parameter(f"E_{i}", "E", "Pa", "", LogNormal(1e6 * (i if own_prior else 1), 0.8), "",
                  belongs_to=f"tau_{i}")
        for i in range(1, units + 1)
    ]  # fmt: skip
    times = [
        Parameter(f"tau_{i}", "tau", "s", "", LogUniform(0.01, 10.0), "", ordered="tau")
        for i in range(1, units + 1)
    ]
    more = [Parameter(f"x_{i}", "x", "1", "", LogNormal(1.0, 1.0), "") for i in range(others)]
    return Prior.from_parameters([*moduli, *times, *more])
