"""A failed job does not end a run. On the screen there is a line as each job begins and ends.

Snakemake's own output comes with `--printshellcmds`, `--verbose` or `--quiet`, and is in its log.
"""

from snakemake.logging import logger
from snakemake_logger_plugin_deabayes import LogHandler, ShortLines


def forget_records():
    """Remove prepared records that a study no longer has: stages read all in the folder."""
    for study in STUDIES:
        names = {
            Path(file).stem for file in prepared_files(study, read_tables(study)[1])
        }
        folder = RESULTS / study / "prepared"
        for path in folder.glob("*.*"):
            if path.stem not in names:
                path.unlink()


onstart:
    workflow.scheduler.keepgoing = True
    forget_records()


asked = workflow.output_settings
if not (asked.printshellcmds or asked.verbose or asked.quiet):
    for handler in list(logger.handlers):
        if handler.name == "DefaultStreamHandler" and asked.dryrun:
            handler.setFormatter(ShortLines(handler.formatter))
        elif handler.name == "DefaultStreamHandler":
            logger.removeHandler(handler)
            logger.addHandler(LogHandler(asked, None))
