"""A run that ends without what it was asked for: how it ends, and what it shows."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

UNFINISHED = Path(workflow.pathvars.items["results"]) / "logs" / "unfinished.json"


INTERRUPTED = []


def note_interruption(number, frame):
    """Snakemake may take a job that was interrupted with it for one that failed."""
    INTERRUPTED.append(number)
    raise KeyboardInterrupt


if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, note_interruption)


def not_made():
    """The files asked for that are not there.

    After a job that runs again Snakemake looks only where inputs are not `ancient`. Those of
    a fit are: an edit of one study can hide what another lacks that has its prior from it.
    """
    asked = workflow.dag_settings
    if asked.until or asked.omit_from or asked.batch:
        return []
    files = [target for target in asked.targets if not workflow.is_rule(target)]
    return [file for file in files if not Path(file).exists()]


def left_by_failures():
    """What failed and what is there, for `deabayes finish`; None if there is no report to build.

    There is none after an interruption, or where jobs are left that no failed one holds up.
    """
    if INTERRUPTED:
        return None
    dag, failed = workflow.dag, workflow.scheduler.failed
    left = set(dag.needrun_jobs())
    rules = {job.rule.name for job in left} - {job.rule.name for job in failed}
    if "report" not in rules or not left <= set(dag.bfs(dag.depending, *failed)):
        return None
    made = [file for job in dag.jobs if job not in left for file in job.output]
    return {
        "failed": [job_failed(job) for job in failed],
        "made": {
            str(folder): [file for file in made if Path(file).is_relative_to(folder)]
            for folder in results_folders()
        },
        "left_out": LEFT_OUT,
    }


def results_folders():
    """The results folders that the report is of."""
    results = Path(workflow.pathvars.items["results"])
    return [results / name for name in STUDIES] + [
        results / "populations" / name for name in POPULATIONS
    ]


def job_failed(job):
    """What a reader must know of a failed job."""
    names = {"study": "", "candidate": "", "population": ""} | job.wildcards_dict
    return {"stage": job.rule.name, **names, "log": job.log[0]}


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
    left = not_made()
    if left:
        raise WorkflowError(
            f"{', '.join(left)}: not made, an edit elsewhere came first; run the same command again"
        )


onerror:
    for job in map(job_failed, workflow.scheduler.failed):
        print("Failed:", *filter(None, job.values()), file=sys.stderr)
    state = left_by_failures()
    if state is not None:
        UNFINISHED.parent.mkdir(parents=True, exist_ok=True)
        UNFINISHED.write_text(json.dumps(state, indent=1))
        print("The report is built from what is there.", file=sys.stderr)
        build_report_in_part()
