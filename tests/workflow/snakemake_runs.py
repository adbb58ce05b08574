"""Runs of snakemake in a folder, and a study small enough for a whole one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TINY = """
studies:
  tiny:
    specimen: {root}/data/tubular
    candidates: [voigt_kelvin_1]
    calibrate: [creep_2000V]
    validate: [creep_2500V, creep_1500V]
    further_experiments: {{longer: {{like: creep_2000V, duration: 2}}}}
    preparation:
      creep:
        - delay: {{}}
        - baseline: {{}}
        - mask_before: {{time: 6 ms, from_step: true}}
        - excitation_knots: {{tolerance: 2 V}}
        - average: {{grid: geometric, first_width: 4 ms, ratio: 1.2, widest: 20 ms}}
sampling: {{ensembles: 2, walkers: 24, max_steps: 200, particles: 64, seed: 1}}
"""


def snakemake(
    folder: Path, *arguments: str | Path, data: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run in `folder`, without a terminal, with public data only where `data` says."""
    with started(folder, *arguments, data=data) as run:
        out, err = run.communicate(timeout=540)
    return subprocess.CompletedProcess(run.args, run.returncode, out, err)


def started(
    folder: Path, *arguments: str | Path, data: Path | None = None
) -> subprocess.Popen[str]:
    """The same run while it goes on, in a group of processes of its own.

    Ctrl-C reaches it also where the tests were started in the background, and ignore it.
    """
    binaries = Path(sys.executable).parent
    return subprocess.Popen(
        [binaries / "snakemake", "--snakefile", ROOT / "Snakefile", "--directory", folder]
        + [str(each) for each in arguments],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        env={
            **os.environ,
            "PATH": f"{binaries}{os.pathsep}{os.environ['PATH']}",
            "DEABAYES_DATA": "" if data is None else str(data),
            "XDG_CACHE_HOME": str(folder / "no_cache"),
        },
    )
