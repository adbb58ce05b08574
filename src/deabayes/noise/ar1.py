"""First-order autoregressive noise without a white part."""

from __future__ import annotations

from deabayes.noise.ornstein_uhlenbeck import OrnsteinUhlenbeck


class AutoRegressive(OrnsteinUhlenbeck):
    """cov(r_j, r_k) = sigma_ar1^2 exp(-|t_j - t_k| / tau_ar1), on any grid.

    On a grid of spacing d this is AR(1) with coefficient exp(-d / tau_ar1).
    Averaging does not shrink correlated noise, so the weights have no effect.
    """

    name = "ar1"
    adding = ()
    amplitude, length, subscript = "sigma_ar1", "tau_ar1", "AR"
    has_white = False
