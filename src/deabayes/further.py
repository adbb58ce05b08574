"""Which experiment to do next: what it would tell about candidates and parameters."""
