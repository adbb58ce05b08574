"""Sampling a posterior with ensembles of walkers: from tempered particles to pooled draws.

`first_pass.run_ensemble` samples one ensemble, `pooling.pool` judges several together and
samples them on. All in z, where the prior is N(0, I); nothing here knows a model.
"""
