"""A failed job does not end a run. On the screen there is a line as each job begins and ends.

Snakemake's own output comes with `--printshellcmds`, `--verbose` or `--quiet`, and is in its log.
"""

import logging
import time

from snakemake.logging import logger
from snakemake_interface_logger_plugins.common import LogEvent

QUICK = ("all", "population_settings")
UNSAID = ("Assuming ", "Select jobs", "Using shell", "Singularity", "Touching ")


class Lines(logging.StreamHandler):
    """When, what became of a job, its rule, study and candidate; where its log is."""

    def __init__(self, stream):
        super().__init__(stream)
        self.jobs = {}
        self.ended = []

    def emit(self, record):
        event = getattr(record, "event", None)
        if event == LogEvent.JOB_INFO:
            words = [record.rule_name, *record.wildcards.values()]
            self.jobs[record.jobid] = " ".join(words)
            if record.rule_name not in QUICK:
                self.line("begins", record.jobid, *record.log)
        elif event == LogEvent.JOB_ERROR:
            self.line("FAILED", record.jobid, *record.log)
        elif event == LogEvent.JOB_FINISHED:
            self.ended.append(record.job_id)
        elif event == LogEvent.PROGRESS:
            for job in self.ended:
                if self.jobs.get(job) and self.jobs[job].split()[0] not in QUICK:
                    self.line("done", job, f"{record.done} of {record.total} jobs")
            self.ended.clear()
        elif event in (None, LogEvent.RUN_INFO) or record.levelno >= logging.WARNING:
            text = record.getMessage()
            if not text.startswith(UNSAID) and "\nCalledProcessError in" not in text:
                self.write(text)

    def line(self, state, job, *details):
        name = self.jobs.get(job, "")
        self.write(f"{time.strftime('%X')}  {state:6}  {name:40}  {' '.join(details)}")

    def write(self, text):
        self.stream.write(f"{text}\n")
        self.flush()


def forget_records():
    """Remove prepared records that a study no longer has: stages read all in the folder."""
    for study in STUDIES:
        names = {
            Path(file).stem for file in prepared_files(study, read_tables(study)[1])
        }
        folder = Path(workflow.pathvars.items["results"], study, "prepared")
        for path in folder.glob("*.*"):
            if path.stem not in names:
                path.unlink()


onstart:
    workflow.scheduler.keepgoing = True
    forget_records()


asked = workflow.output_settings
if not (asked.dryrun or asked.printshellcmds or asked.verbose or asked.quiet):
    for handler in list(logger.handlers):
        if handler.name == "DefaultStreamHandler":
            logger.removeHandler(handler)
            logger.addHandler(Lines(handler.stream))
