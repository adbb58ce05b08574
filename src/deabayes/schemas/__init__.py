"""JSON schemas of config.yaml, specimen.yaml and experiments.csv, every key described."""
