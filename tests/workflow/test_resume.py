"""A run killed at any moment goes on to the same draws, byte for byte."""

import hashlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

PROGRAM = """
import sys, time
from pathlib import Path
import numpy as np
from deabayes.sampling.first_pass import run_ensemble
from deabayes.sampling.pooling import pool
from deabayes.study import Sampling

def log_likelihood(z):
    time.sleep(1e-4)
    return -0.5 * ((z[:, 1] - z[:, 0] ** 2) / 0.05) ** 2

settings = Sampling(
    ensembles=2, walkers=32, max_steps=1500, particles=128, autocorrelation_times=1000.0
)
folder = Path(sys.argv[1])
seeds = [np.random.SeedSequence([3, index]) for index in range(3)]
ensembles = [
    run_ensemble(log_likelihood, 2, settings, seeds[index], folder / f"ensemble_{index}")
    for index in range(2)
]
result = pool(log_likelihood, ensembles, settings, seeds[2], folder / "pool")
assert all(ensemble.refitted for ensemble in result.ensembles)
parts = result.thinned(1_000_000)
counts = [(e.steps, e.evaluations, e.failures) for e in result.ensembles]
(folder / "done").write_bytes(b"".join(p.tobytes() for p in parts) + repr(counts).encode())
"""


def start(folder: Path) -> subprocess.Popen:
    folder.mkdir(exist_ok=True)
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen([sys.executable, "-c", PROGRAM, str(folder)], env=environment)


def digest(folder: Path) -> str:
    return hashlib.sha256((folder / "done").read_bytes()).hexdigest()


def files(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*.npz"))
    }


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("uninterrupted")
    began = time.monotonic()
    assert start(folder).wait() == 0
    return folder, time.monotonic() - began


def test_killed_at_random_times(tmp_path, uninterrupted):
    """Kill once a new checkpoint or a half-written one has appeared, a random moment later."""
    reference, duration = uninterrupted
    rng = np.random.default_rng(8)
    kills = 0
    while True:
        process = start(tmp_path)
        seen, deadline = len(list(tmp_path.rglob("*.npz"))), time.monotonic() + 3 * duration
        wanted = seen + int(rng.integers(3, 14))
        while process.poll() is None and time.monotonic() < deadline:
            if len(list(tmp_path.rglob("*.npz"))) >= wanted:
                break
            time.sleep(0.001)
        time.sleep(float(rng.random()) * 0.02)
        if process.poll() is not None:
            break
        process.send_signal(signal.SIGKILL)
        process.wait()
        kills += 1
    assert process.returncode == 0
    assert kills >= 3
    assert digest(tmp_path) == digest(reference)
    assert files(tmp_path) == files(reference)


def test_killed_while_a_chunk_is_being_written(tmp_path, uninterrupted):
    """What a kill inside a write leaves behind: a partial file, or a last chunk cut short."""
    reference, _ = uninterrupted
    assert start(tmp_path).wait() == 0
    chain = tmp_path / "ensemble_1" / "chain"
    last = sorted(chain.glob("chunk_*.npz"))[-2]
    (chain / f".{last.name}.123.tmp").write_bytes(last.read_bytes()[:200])
    last.write_bytes(last.read_bytes()[:1000])
    (tmp_path / "pool" / "refit_1" / "refitted.npz").unlink()
    assert start(tmp_path).wait() == 0
    assert digest(tmp_path) == digest(reference)
    assert files(tmp_path) == files(reference)
