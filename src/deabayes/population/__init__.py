"""Populations: mean and spread of several specimens of one material, and a new specimen.

`settings` says which studies form a population. `member` turns one specimen's posterior into a
likelihood of the population. `model` holds the population itself. `specimens` computes the
consequences for the specimens and for a new one. `files` writes the results.
"""
