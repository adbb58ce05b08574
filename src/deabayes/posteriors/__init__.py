"""Posterior files: what is in them, how they are written and read, how they become priors."""
