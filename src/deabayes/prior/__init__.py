"""The joint prior of a candidate's parameters, and how overrides and other posteriors enter it."""
