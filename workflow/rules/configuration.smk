"""The configuration as the library reads it: duplicate keys are mistakes, `1e3` is a number."""

import os
import sys
from pathlib import Path

from deabayes.faults import UserError
from deabayes.records.schema import read_yaml
from snakemake.utils import update_config


def end(error):
    """End with a user's mistake alone; where in our files it was found is no help."""
    if isinstance(error, OSError):
        if error.filename is None:
            raise error
        error = f"{error.filename}: {error.strerror}; it must be there for you to read"
    print(error, file=sys.stderr)
    sys.exit(1)


def check_yaml(path):
    """End with the file and line of a mistake in a configuration that Snakemake is to read."""
    try:
        read_yaml(Path(path))
    except (UserError, OSError) as error:
        end(error)


def say_what_is_laid_over(path):
    """That files of the command line bring no studies, so that those of `path` are run."""
    files = [os.path.relpath(file) for file in workflow.config_settings.configfiles]
    if files and workflow.is_main_process:
        print(
            f"{', '.join(files)}: without studies of its own; every study of {path} is run, with "
            "these settings over its own",
            file=sys.stderr,
        )


def config_files():
    """The files that were read; those of the command line have the last say."""
    count = len(workflow.config_settings.configfiles)
    files = [*workflow.configfiles[count:], *workflow.configfiles[:count]]
    return [os.path.relpath(path) for path in files]


def settings_given():
    """What the files and `--config key=value` say."""
    given = {}
    for path in config_files():
        update_config(given, read_yaml(Path(path)))
    update_config(given, workflow.config_settings.config)
    return given
