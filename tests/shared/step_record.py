"""A step of the voltage, whatever file it comes in."""

from __future__ import annotations

import numpy as np

from deabayes.records.columns import RawRecord

TIME = np.array([0.0, 0.5, 1.0])
VOLTAGE_KV = np.array([0.0, 2.5, 2.5])


def check(record: RawRecord) -> None:
    np.testing.assert_allclose(record.columns["time"], TIME)
    np.testing.assert_allclose(record.columns["voltage"], 1e3 * VOLTAGE_KV)
    assert record.units["voltage"] == "V"
    assert len(record.sha256) == 64
