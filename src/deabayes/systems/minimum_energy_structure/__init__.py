"""The minimum-energy structure (2019): a slider-crank with a film and relaxation units."""
