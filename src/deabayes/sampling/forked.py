"""Work that leaves its result on disk, done in processes of its own side by side."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable, Sequence
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess

Task = Callable[[], object]


def run_apart(tasks: Sequence[Task], processes: int) -> None:
    """Do tasks, at most `processes` at a time, each in a copy of this process.

    What they return is lost, and so is what they raise: whoever asks does again what is not
    on disk afterwards, and comes upon the same error. Where a process cannot be copied
    safely (anywhere but on Linux) nothing is done.
    """
    if sys.platform != "linux":
        return
    context = multiprocessing.get_context("fork")
    waiting, running = list(tasks), list[BaseProcess]()
    try:
        while waiting or running:
            while waiting and len(running) < processes:
                running.append(context.Process(target=_alone, args=(waiting.pop(0),), daemon=True))
                running[-1].start()
            wait([each.sentinel for each in running])
            running = [each for each in running if each.is_alive()]
    finally:
        for each in running:
            each.terminate()


def _alone(task: Task) -> None:
    try:
        task()
    except BaseException:
        os._exit(1)
    os._exit(0)
