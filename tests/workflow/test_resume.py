"""A run killed at any moment goes on to the same draws, byte for byte."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import os, signal, sys, time
from pathlib import Path
import numpy as np
from deabayes.sampling import checkpoint, engine
from deabayes.sampling.problem import Problem
from deabayes.study import Sampling

folder, kills = Path(sys.argv[1]), sys.argv[2:]
settings = Sampling(ensembles=2, particles=128, max_steps=900, autocorrelation_times=1e6)

def log_likelihood(z):
    time.sleep(1e-4)
    return -0.5 * ((z[:, 1] - z[:, 0] ** 2) / 0.05) ** 2

def work():
    found = engine.sample(Problem(log_likelihood, 2), settings, np.random.SeedSequence(3), folder)
    assert found.rounds >= 3
    numbers = found.steps, found.burn_in, found.evaluations, found.failures, found.acceptance
    parts = *found.thinned(10**6), found.convergence.table.to_numpy()
    content = b"".join(part.tobytes() for part in parts) + repr(numbers).encode()
    (folder / "done").write_bytes(content)

def die():
    os.kill(os.getpid(), signal.SIGKILL)

def dies_at(kill):
    # "judged 2 after": as the second call of that state ends. "write 5 within": of the fifth file.
    name, count, moment = kill.split()
    calls = []
    if name == "write":
        def write(path, arrays, real=checkpoint.write_arrays):
            calls.append(path)
            if len(calls) == int(count):
                real(path.with_name(f".{path.name}.123.tmp"), arrays)
                die()
            real(path, arrays)
        checkpoint.write_arrays = write
    else:
        def state(run, real=getattr(engine, "_" + name)):
            calls.append(name)
            if moment == "before" and len(calls) == int(count):
                die()
            following = real(run)
            if len(calls) == int(count):
                die()
            return following
        setattr(engine, "_" + name, state)

def in_a_child(prepare, wait=None):
    child = os.fork()
    if child == 0:
        code = 1
        try:
            prepare()
            work()
            code = 0
        finally:
            os._exit(code)
    if wait is not None:
        time.sleep(wait)
        if os.waitpid(child, os.WNOHANG)[0]:
            return False
        os.kill(child, signal.SIGKILL)
    status = os.waitpid(child, 0)[1]
    return os.WIFSIGNALED(status)

if kills[:1] == ["random"]:
    rng = np.random.default_rng(int(kills[1]))
    for number in range(12):
        in_a_child(lambda: None, wait=0.5 * rng.random())
else:
    for kill in kills:
        assert in_a_child(lambda: dies_at(kill)), kill
assert not in_a_child(lambda: None)
"""

STATES = [
    f"{state} {call} {moment}"
    for call, states in (
        (1, ("warm_up", "fitted", "sampling", "judged", "refitted")),
        (2, ("fitted", "sampling", "judged", "refitted")),
        (3, ("fitted", "sampling", "judged")),
    )
    for state in states
    for moment in ("before", "after")
]


def run(folder: Path, *kills: str) -> None:
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    subprocess.run([sys.executable, "-c", PROGRAM, folder, *kills], env=environment, check=True)


def files(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted([*folder.rglob("*.npz"), folder / "done"])
        if not path.name.startswith(".")
    }


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("uninterrupted")
    run(folder)
    return files(folder)


@pytest.mark.parametrize(
    "kills",
    [STATES, [f"write {number} within" for number in (1, 1, 1, 2, 2, 3, 1)], ["random", "8"]],
    ids=["in every state", "as a file is written", "at random moments"],
)
def test_killed(tmp_path: Path, uninterrupted: dict[str, str], kills: list[str]) -> None:
    run(tmp_path, *kills)
    assert files(tmp_path) == uninterrupted


def test_files_that_are_cut_short_or_lost(tmp_path: Path, uninterrupted: dict[str, str]) -> None:
    """What a kill inside a write, or a hand, leaves behind: it is made again, and no more."""
    run(tmp_path)
    rounds = sorted(tmp_path.glob("round_*"))
    assert len(rounds) >= 3
    path = rounds[-1] / "chunk_00001.npz"
    path.write_bytes(path.read_bytes()[:1000])
    (rounds[1] / "chunk_00001.npz").unlink()
    run(tmp_path)
    assert files(tmp_path) == uninterrupted
