"""Checks of a study and its folder before anything is run."""
