"""A plain record as text."""

PLAIN = "time [s],voltage [kV],displacement [mm]\n0,0,0.5\n0.5,2.5,1.5\n1,2.5,2\n"
