"""Hide a strip's slack: after unloading it no longer pulls."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from deabayes.preparation.settings import Settings
from deabayes.preparation.working import WorkingRecord


def mask_slack(record: WorkingRecord, settings: Mapping[str, object]) -> WorkingRecord:
    """Hide the response from where it falls to `threshold` after the excitation's peak.

    A strip that has relaxed is longer than when it was mounted and buckles
    before the crosshead is back; no model of tension describes that. Hidden
    is everything between the first and the last sample at or below the
    threshold, so that noise around it does not leave single samples.

    Settings
    --------
    threshold : of the response, e.g. 0.01 N.
    """
    read = Settings("mask_slack", settings, record, ("threshold",))
    threshold = read.quantity("threshold", record.response_unit)
    departure = np.abs(record.excitation - record.excitation[0])
    peak = record.excitation_coordinate[int(np.argmax(departure))]
    slack = np.flatnonzero((record.coordinate > peak) & (record.response <= threshold))
    hidden = np.zeros(record.used.size, dtype=bool)
    if slack.size:
        hidden[slack[0] : slack[-1] + 1] = True
    return record.mask(hidden)
