"""The membrane actuator (Nguyen et al. 2021)."""
