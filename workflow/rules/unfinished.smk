"""A run in which jobs failed: it names them, and builds the report from what is there."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

UNFINISHED = RESULTS / "logs" / "unfinished.json"


def left_by_failures():
    """What failed and what is there, for `deabayes finish`; None if there is no report to build.

    There is none after an interruption, which leaves jobs running or jobs that no failed one holds
    up.
    """
    dag, failed = workflow.dag, workflow.scheduler.failed
    left = set(dag.needrun_jobs())
    rules = {job.rule.name for job in left - failed}
    held_up = left <= set(dag.bfs(dag.depending, *failed))
    if workflow.scheduler.running or "report" not in rules or not held_up:
        return None
    made = [file for job in dag.jobs if job not in left for file in job.output]
    folders = [RESULTS / name for name in STUDIES]
    folders += [RESULTS / "populations" / name for name in POPULATIONS]
    return {
        "failed": [failed_job(job) for job in failed],
        "made": {
            str(folder): [file for file in made if Path(file).is_relative_to(folder)]
            for folder in folders
        },
        "left_out": LEFT_OUT,
    }


def failed_job(job):
    """What a reader must know of a failed job."""
    names = dict.fromkeys(("study", "candidate", "population", "record"), "")
    return {"stage": job.rule.name, **names, **job.wildcards_dict, "log": job.log[0]}


def build_report_in_part():
    """Build the report from what is there, as a file that is older than all it is made from.

    Snakemake is also made to forget what an earlier report was made from. So the next run makes
    the report again, and what is missing for it.
    """
    (report,) = (job for job in workflow.dag.jobs if job.rule.name == "report")
    page, tables = report.output
    command = ["deabayes", "finish", UNFINISHED, "-o", page, "--tables", tables]
    subprocess.run(command, check=False)
    for file in report.output:
        workflow.persistence.cleanup_metadata(file)
    if Path(page).exists():
        os.utime(page, (1, 1))


onsuccess:
    UNFINISHED.unlink(missing_ok=True)
    shutil.rmtree(UNFINISHED.with_suffix(""), ignore_errors=True)


onerror:
    for job in map(failed_job, workflow.scheduler.failed):
        print("Failed:", *filter(None, job.values()), file=sys.stderr)
    state = left_by_failures()
    if state is not None:
        UNFINISHED.parent.mkdir(parents=True, exist_ok=True)
        UNFINISHED.write_text(json.dumps(state, indent=1))
        print("The report is built from what is there.", file=sys.stderr)
        build_report_in_part()
