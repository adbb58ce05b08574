"""The log-posterior of a candidate given prepared records."""
