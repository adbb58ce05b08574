"""What is known of a minimum-energy structure's hinges besides its rest angle."""

from __future__ import annotations

import math

from deabayes.experiment import Quantity, Specimen
from deabayes.faults import UserError

FRAME = {
    "youngs_modulus": "Pa",
    "frame_thickness": "m",
    "frame_width": "m",
    "cutout_radius": "m",
    "hinge_length": "m",
}
"""Quantities of the frame from which K = E (W - 2r) t^3/(12 s) -> SI unit."""


def measured_hinge(specimen: Specimen) -> Quantity | None:
    """The hinges' stiffness K with its sd, measured or computed from the frame; None if neither.

    Raises
    ------
    UserError
        A stiffness without an sd (the rest angle and the film give another one, and nothing
        says which to believe), half a frame, or both.
    """
    given = specimen.quantities
    frame = [name for name in FRAME if name in given]
    if "hinge_stiffness" in given and frame:
        raise UserError(
            f"specimen {specimen.name!r} gives hinge_stiffness and {frame[0]}: the hinges' "
            "stiffness follows from either; remove one from quantities in specimen.yaml"
        )
    if frame and len(frame) < len(FRAME):
        missing = ", ".join(name for name in FRAME if name not in given)
        raise UserError(
            f"specimen {specimen.name!r}: the hinges' stiffness follows from the frame's "
            f"dimensions only with all of them; add {missing} to quantities in specimen.yaml"
        )
    found = _of_frame(specimen) if frame else given.get("hinge_stiffness")
    if found is not None and not (found.sd is not None and found.sd > 0.0):
        raise UserError(
            f"specimen {specimen.name!r}: the hinges' stiffness needs an sd, because it also "
            "follows from the rest angle and the film; give hinge_stiffness (or what it follows "
            "from) an sd in specimen.yaml, or leave it out"
        )
    return found


def _of_frame(specimen: Specimen) -> Quantity:
    """K = E (W - 2r) t^3/(12 s), the paper's (13), its sd to first order."""
    modulus, thickness, width, radius, length = (specimen.quantities[name] for name in FRAME)
    net = width.value - 2.0 * radius.value
    if not net > 0.0:
        raise UserError(
            f"specimen {specimen.name!r}: frame_width must exceed twice cutout_radius; found "
            f"{width.value:g} and {radius.value:g} m"
        )
    value = modulus.value * net * thickness.value**3 / (12.0 * length.value)
    shares = (
        (modulus.sd or 0.0) / modulus.value,
        3.0 * (thickness.sd or 0.0) / thickness.value,
        (width.sd or 0.0) / net,
        2.0 * (radius.sd or 0.0) / net,
        (length.sd or 0.0) / length.value,
    )
    return Quantity(value, "N*m/rad", value * math.hypot(*shares), "from the frame's dimensions")
