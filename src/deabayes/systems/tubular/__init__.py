"""The tubular actuator (Sarban et al. 2012)."""
