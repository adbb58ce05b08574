"""The minimum-energy structure (2019): film, relaxation units, slider-crank."""
