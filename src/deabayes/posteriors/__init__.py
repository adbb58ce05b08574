"""Posterior files: their content, how to write and read them, and how to use them as priors."""
