"""Every long check in one form: worlds -> tasks -> rows of a CSV file -> tables and figures.

A check lists tasks and computes one row for each. Rows are appended as they finish, so that a
stopped check continues where it was. `summary` makes tables and figures of the rows.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from multiprocessing import Pool
from pathlib import Path

Task = Mapping[str, str | int]
Row = dict[str, object]
OUTPUT = Path("docs/validation")


def parser(doc: str | None, replicates: int = 100) -> argparse.ArgumentParser:
    """Return the options of every check: how many tasks, in how many processes, and the folder."""
    options = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--replicates", type=int, default=replicates)
    options.add_argument("--processes", type=int, default=2)
    options.add_argument("--output", type=Path, default=OUTPUT, help="folder of the tables")
    return options


def append(
    path: Path,
    tasks: Sequence[Task],
    compute: Callable[[Task], Row | list[Row]],
    seed: int | None,
    processes: int,
) -> None:
    """Append the rows of every task that has none: the task, its results and the provenance.

    Parameters
    ----------
    tasks : all with the same names, which are the first columns of the file.
    compute : a function at the top of a module, so that another process can call it. It returns
        one row, or several rows of which the last one repeats the task.
    seed : for the provenance, which rows without a seed do not have.
    """
    waiting = missing(path, tasks)
    with Pool(processes) as pool:
        results = pool.imap_unordered(_WithTask(compute), waiting)
        for count, (task, result) in enumerate(results, start=1 + len(tasks) - len(waiting)):
            for row in result if isinstance(result, list) else [result]:
                write(path, {**task, **row, **({} if seed is None else provenance(seed))})
            print(f"{path.stem} {dict(task)}: {count} of {len(tasks)}", flush=True)


class _WithTask:
    """A function that returns its task and the result."""

    def __init__(self, compute: Callable[[Task], Row | list[Row]]) -> None:
        self.compute = compute

    def __call__(self, task: Task) -> tuple[Task, Row | list[Row]]:
        return task, self.compute(task)


def missing(path: Path, tasks: Sequence[Task]) -> list[Task]:
    """Return the tasks that no row of the file repeats."""
    done = {tuple(row[name] for name in tasks[0]) for row in read(path)} if tasks else set()
    return [task for task in tasks if tuple(str(value) for value in task.values()) not in done]


def read(path: Path) -> Iterator[dict[str, str]]:
    """Read the rows of a file; none if there is no file."""
    if path.exists():
        with path.open(encoding="utf-8") as stream:
            yield from csv.DictReader(stream)


def provenance(seed: int) -> Row:
    """Return seed, version and day, which every row ends with."""
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    return {"seed": seed, "deabayes": version("deabayes"), "date": today}


def write(path: Path, row: Row) -> None:
    """Append one row; the first row also writes the header.

    Raises
    ------
    ValueError : the file has other columns.
    """
    header = next((list(old) for old in read(path)), None)
    if header is not None and header != list(row):
        differing = sorted(set(header) ^ set(row))
        raise ValueError(f"{path}: its columns differ from the new row's ({differing}); move it")
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(row))
        if header is None:
            writer.writeheader()
        writer.writerow(row)
        stream.flush()
        os.fsync(stream.fileno())


def write_table(path: Path, rows: Iterable[Row]) -> None:
    """Write and print a small table that replaces the file."""
    import pandas as pd

    table = pd.DataFrame(rows)
    table.to_csv(path, index=False)
    print(f"\n{path.name}\n{table.to_string(index=False)}")
