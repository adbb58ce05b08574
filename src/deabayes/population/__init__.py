"""Several specimens of one material: what they share, how they scatter, what a new one will be.

`settings` says which studies make a population, `member` holds one specimen's posterior as a
likelihood of the population, `model` the population itself, `specimens` what follows for each
specimen and for a new one, `files` what is written.
"""
