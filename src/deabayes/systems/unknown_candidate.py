"""A name that is no candidate of a system."""

from __future__ import annotations

from deabayes.faults import UserError


class UnknownCandidate(UserError):
    """Raised by a system; `systems.build` knows whether it is another one's."""
