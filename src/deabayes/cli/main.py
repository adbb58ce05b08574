"""The `deabayes` command: each subcommand calls one function of the library."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

import click

from deabayes.cli import fitting, judging, records, using
from deabayes.faults import UserError

SMALL_MATRICES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Numbers of threads in linear algebra; our matrices are too small for more than one."""


@click.group(
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="`snakemake --cores 2` runs all stages of all studies; these commands run one by hand.",
)
@click.version_option(package_name="deabayes")
def cli() -> None:
    """Bayesian characterisation of dielectric elastomer actuators.

    STUDY is the name of a study in config.yaml, or a file with one study's
    settings (results/NAME/study.yaml).
    """


for command in (
    records.new,
    records.check,
    fitting.prepare,
    fitting.fit,
    judging.status,
    judging.score,
    judging.nested,
    judging.compare,
    judging.further,
    using.predict,
    judging.analyse,
    judging.figures,
    judging.report,
    judging.finish,
    using.simulate,
    using.export,
    records.data,
    judging.population,
):
    cli.add_command(command)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; a user's mistake ends with one message and exit status 1 or 2."""
    for name in SMALL_MATRICES:
        os.environ.setdefault(name, "1")
    try:
        cli.main(args=arguments, prog_name="deabayes", standalone_mode=False)
    except UserError as error:
        _end(error)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        _end("interrupted; the same command continues where this one stopped")
    except OSError as error:
        if error.filename is None:
            raise
        _end(f"{error.filename}: {error.strerror}")
    except (Exception, SystemExit) as error:
        from deabayes.own_models.loading import fault_in_a_model

        fault = fault_in_a_model(error)  # an error inside a user's own model is a user's mistake
        if fault is None:
            raise
        _end(fault)


def _end(message: object) -> None:
    click.echo(f"deabayes: {message}", err=True)
    sys.exit(1)


if __name__ == "__main__":
    main()
