"""Read records from TDMS files."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from deabayes.experiment import FloatArray
from deabayes.faults import Report, UserError
from deabayes.records.columns import Column, Table, from_header
from deabayes.records.matlab import opened, pick

TAG, LEAD_IN = b"TDSm", 28
"""Bytes before every segment: tag, flags and version of four bytes each, then two lengths."""
FLAGS, BIG_ENDIAN, LENGTH = 4, 1 << 6, 12
"""Offset of the flags, the flag for big-endian lengths, and offset of the segment's length."""


class Sampling(NamedTuple):
    """When a channel was sampled, from its waveform properties."""

    increment: float | None
    offset: float
    start: object

    def __str__(self) -> str:
        every = "not stated" if self.increment is None else f"every {self.increment:g} s"
        after = "" if self.start is None else f" after {self.start}"
        return f"{every}, start {self.offset:g} s{after}"

    def times(self, samples: int) -> FloatArray:
        """Return the times (samples,) in seconds since the start."""
        return self.offset + (self.increment or 0.0) * np.arange(samples, dtype=float)


def read_tdms(path: Path, columns: Sequence[Column] | None) -> Table:
    """Read channels of a TDMS file; units come from channel names or their `unit_string`.

    A channel is named ``group/channel`` if several groups have a channel of its name. Without a
    time channel, time is computed from the channels' waveform properties.
    """
    from nptdms import TdmsFile

    if _truncated(path):
        raise UserError(f"{path}: ends within a segment, it is truncated; copy it again")
    groups = opened(TdmsFile.read, path, "a TDMS file").groups()
    paths = {f"{group.name}/{c.name}": c for group in groups for c in group.channels()}
    counts = Counter(channel.name for channel in paths.values())
    channels = {c.name if counts[c.name] == 1 else full: c for full, c in paths.items()}
    wanted = [_column(c) for c in paths.values()] if columns is None else columns
    wanted = [replace(c, source=_called(c, paths, channels)) for c in wanted]
    samplings = _samplings(wanted, channels)
    report = Report(str(path))
    _check_groups(wanted, paths, channels, report)
    _check_sampling(samplings, report)
    report.raise_faults()
    arrays = {name: np.asarray(channel[:]) for name, channel in channels.items()}
    name, sampling = next(iter(samplings.items()), ("", Sampling(None, 0.0, None)))
    if sampling.increment is not None and not _clocked(wanted, channels):
        arrays["time"] = sampling.times(arrays[name].size)
        wanted = [c for c in wanted if c.source != "time"] + [Column("time", "s", source="time")]
    table = pick(wanted, arrays, "channel", report)
    report.raise_faults()
    return table


def _truncated(path: Path) -> bool:
    """Whether the file ends within a segment; other files are left to the TDMS reader."""
    end, size = 0, path.stat().st_size
    with path.open("rb") as file:
        while end < size:
            file.seek(end)
            lead_in = file.read(LEAD_IN)
            if not lead_in.startswith(TAG):
                return end > 0
            if len(lead_in) < LEAD_IN:
                return True
            (flags,) = struct.unpack_from("<I", lead_in, FLAGS)
            order = ">" if flags & BIG_ENDIAN else "<"
            end += LEAD_IN + struct.unpack_from(f"{order}Q", lead_in, LENGTH)[0]
    return end > size


def _column(channel: Any) -> Column:
    """Return a channel's column with its own name and unit."""
    column = from_header([channel.name])[0]
    unit = column.unit or channel.properties.get("unit_string")
    return Column(column.name, unit, source=channel.name)


def _called(column: Column, paths: Mapping[str, Any], channels: Mapping[str, Any]) -> str:
    """Return the key in `channels` of a channel that may be named with its group."""
    name = column.source or column.name or "-"
    return paths[name].name if name in paths and name not in channels else name


def _clocked(columns: Sequence[Column], channels: Mapping[str, Any]) -> bool:
    """Whether there is a time channel."""
    return any(c.name == "time" and c.source in channels for c in columns)


def _samplings(columns: Sequence[Column], channels: Mapping[str, Any]) -> dict[str, Sampling]:
    """Sampling of each channel with a unit; optional if there is a time channel."""
    found = {}
    for column in columns:
        name = column.source or ""
        if column.unit is not None and column.name != "time" and name in channels:
            stated = channels[name].properties.get
            offset = float(stated("wf_start_offset") or 0.0)
            found[name] = Sampling(stated("wf_increment"), offset, stated("wf_start_time"))
    clocked = _clocked(columns, channels)
    return {n: s for n, s in found.items() if s.increment is not None or not clocked}


def _check_groups(
    columns: Sequence[Column], paths: Mapping[str, Any], channels: Mapping[str, Any], report: Report
) -> None:
    """Report channel names that occur in several groups."""
    for column in columns:
        name = column.source
        groups = [full.removesuffix(f"/{name}") for full, c in paths.items() if c.name == name]
        if groups and name not in channels and column.name != "-":
            example = f"{groups[0]}/{name} = {column.name} [{column.unit or '1'}]"
            report.fault(
                f"channel {name!r} is in groups {' and '.join(groups)}; name one in the `columns` "
                f"column of experiments.csv, such as {example!r}"
            )


def _check_sampling(samplings: Mapping[str, Sampling], report: Report) -> None:
    """Report the first channel that is sampled at other times than the one before it."""
    for one, other in pairwise(samplings):
        if samplings[one] != samplings[other]:
            report.fault(
                f"channels {one} and {other} have different sampling ({samplings[one]}; "
                f"{samplings[other]}); bring them to one sampling, or name others"
            )
            return
