"""What every unit test runs under."""

from __future__ import annotations

import pytest

from deabayes.analyses import influence


@pytest.fixture(scope="session", autouse=True)
def few_model_runs():
    """The analysis `influence` on few draws: its size is for a paper's intervals."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(influence, "GROUPS", 128)
        patch.setattr(influence, "DRAWS", 200)
        yield
