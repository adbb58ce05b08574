"""Situations from public bug reports and files, with the values that are right."""
