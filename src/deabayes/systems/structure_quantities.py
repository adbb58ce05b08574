"""What is to be known of a minimum-energy structure: units, symbols, meanings."""

from __future__ import annotations

from deabayes.systems.structure_hinge import FRAME

REQUIRED = {
    "link_length": "m",
    "mass_centre": "m",
    "link_mass": "kg",
    "slider_mass": "kg",
    "rotational_inertia": "kg*m^2",
    "film_thickness": "m",
    "prestretch": "1",
    "window_area": "m^2",
    "rest_angle": "rad",
}
"""Quantity -> SI unit."""
OPTIONAL = {
    "relative_permittivity": "1",
    "gravity": "m/s^2",
    "hinge_stiffness": "N*m/rad",
    **FRAME,
}
UNCERTAIN = {
    "relative_permittivity": (
        r"\varepsilon_r",
        "relative permittivity of the film; fitted where it is not given",
    ),
    "rest_angle": (r"\theta_0", "angle of a link to the line between the ends, without a voltage"),
    "window_area": ("A_0", "area of the film in the frame, flat and stretched"),
    "film_thickness": ("t_0", "thickness of the film as it is stretched in the flat frame"),
    "prestretch": (r"\lambda_p", "stretch of the film in the flat frame, the same both ways"),
    "link_length": ("L", "length of one of the two links"),
    "mass_centre": ("l_m", "distance of a link's mass centre from its outer end"),
    "link_mass": ("m_1", "mass of one link"),
    "slider_mass": ("m_2", "mass of what moves along the line between the ends"),
    "rotational_inertia": ("J", "rotational inertia of one link about its mass centre"),
}
"""Quantities that become parameters where they carry an sd: symbols and meanings."""
MEANINGS = {
    "force": "on what holds the slider, outwards positive: blocking force under a voltage",
    "displacement": "of the slider since rest, outwards positive",
    "gravity": "0 for a structure that lies on its side; 9.80665 m/s^2 where it is left out",
    "hinge_stiffness": "of one hinge, measured; needs an sd (else it follows from the rest angle)",
    "youngs_modulus": "Young's modulus of the frame",
    **{name: meaning for name, (_, meaning) in UNCERTAIN.items()},
}
