"""Compare candidates by evidence and left-out blocks, and choose the one the records support."""
