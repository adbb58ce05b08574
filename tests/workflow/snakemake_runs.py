"""Runs of snakemake in a folder, and a study small enough for a whole one."""

from __future__ import annotations

import os
import re
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

    Programs in `folder/bin`, such as one in the place of `deabayes`, come first.
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
            "PATH": os.pathsep.join([f"{folder}/bin", f"{binaries}", os.environ["PATH"]]),
            "DEABAYES_DATA": "" if data is None else str(data),
            "XDG_CACHE_HOME": str(folder / "no_cache"),
        },
    )


def planned(folder: Path, *arguments: str | Path) -> set[str]:
    """The jobs that would run now, such as `fit tubular voigt_kelvin_1`: rule and wildcards."""
    run = snakemake(folder, "--cores", "1", "--dry-run", *arguments)
    assert run.returncode == 0, run.stderr
    blocks = re.findall(r"^(?:local)?rule (\w+):\n((?:    .*\n)+)", run.stdout, re.MULTILINE)
    jobs = set()
    for rule, block in blocks:
        wildcards = re.findall(r"^    wildcards: (.*)$", block, re.MULTILINE)
        jobs.add(" ".join([rule, *re.findall(r"=([^,\s]+)", " ".join(wildcards))]))
    return jobs


STUB = """\
#!/bin/sh
# Stands for deabayes: makes the files that a command is to make, and nothing in them.
echo "threads: $OMP_NUM_THREADS"
command=$1
while [ $# -gt 0 ]; do
    case $1 in
        -o|--summary|--errors|--tables) made="$made $2";;
        --record) record=$2;;
    esac
    shift
done
for path in $made; do
    case $command:$path in
        prepare:*) touch "$path/$record.nc";;
        *.*) touch "$path";;
        *) mkdir -p "$path";;
    esac
done
"""


def write_stub(folder: Path, text: str = STUB) -> None:
    """Put a program in the place of `deabayes` for runs in this folder: nothing is computed."""
    path = folder / "bin" / "deabayes"
    path.parent.mkdir()
    path.write_text(text)
    path.chmod(0o755)
