"""Rows of a CSV file, appended as replicates finish, so that a stopped run goes on where it was."""

from __future__ import annotations

import csv
import datetime
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.metadata import version
from multiprocessing import Pool
from pathlib import Path

Task = Mapping[str, str | int]
Row = dict[str, object]


def read(path: Path) -> Iterator[dict[str, str]]:
    """The rows of a file; none where there is no file."""
    if path.exists():
        with path.open(encoding="utf-8") as stream:
            yield from csv.DictReader(stream)


def missing(path: Path, tasks: Sequence[Task]) -> list[Task]:
    """The tasks that no row of the file answers; a row answers the task whose values it repeats."""
    done = [dict(row) for row in read(path)]
    answered = {tuple(row[name] for name in tasks[0]) for row in done} if tasks else set()
    return [task for task in tasks if tuple(str(value) for value in task.values()) not in answered]


def append(
    path: Path, tasks: Sequence[Task], compute: Callable[[Task], Row], seed: int, processes: int
) -> None:
    """Append a row for every task that has none: the task, its results, where they come from.

    Parameters
    ----------
    tasks : all with the same names; the same names in every row of one file.
    compute : a function at the top of a module, so that another process can call it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    waiting = missing(path, tasks)
    with Pool(processes) as pool:
        for count, (task, result) in enumerate(
            pool.imap_unordered(_Paired(compute), waiting), start=1
        ):
            write(path, {**task, **result, **provenance(seed)})
            done = len(tasks) - len(waiting) + count
            print(f"{path.stem} {dict(task)}: {done} of {len(tasks)}", flush=True)


def provenance(seed: int) -> Row:
    """Seed, version and day, kept with every row."""
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    return {"seed": seed, "deabayes": version("deabayes"), "date": today}


class _Paired:
    """`compute` with its task beside the result."""

    def __init__(self, compute: Callable[[Task], Row]) -> None:
        self.compute = compute

    def __call__(self, task: Task) -> tuple[Task, Row]:
        return task, self.compute(task)


def write(path: Path, row: Row) -> None:
    """Append one row; the first brings the header. A row with other columns is refused."""
    header = next((list(old) for old in read(path)), None)
    if header is not None and header != list(row):
        odd = sorted(set(header) ^ set(row))
        raise ValueError(f"{path}: its columns are not those of the new row ({odd}); move it away")
    with path.open("a", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(row))
        if header is None:
            writer.writeheader()
        writer.writerow(row)
        stream.flush()
        os.fsync(stream.fileno())
