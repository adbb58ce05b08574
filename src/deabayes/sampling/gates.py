"""A gate of convergence that was not passed: by what, by how much, and whether more steps help."""

from __future__ import annotations

from dataclasses import dataclass

LONGER = "sample longer"


@dataclass(frozen=True)
class Failed:
    """A gate that a quantity, a run or a mode did not pass.

    Attributes
    ----------
    gate : which one; all of a name are alike and may be said as one.
    of : the quantity, run or mode.
    text : what is the matter with it.
    badness : how far from the gate; of two of a gate the larger is the worse.
    longer : more steps of the same kind may help.
    """

    gate: str
    of: str
    text: str
    badness: float
    longer: bool = True

    def __str__(self) -> str:
        return f"{self.of}: {self.text}; {LONGER}" if self.longer else f"{self.of}: {self.text}"
