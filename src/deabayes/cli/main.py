"""The `deabayes` command: each subcommand calls one function of the library."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

import click

from deabayes.cli import fitting, judging, records, using
from deabayes.faults import UserError

SMALL_MATRICES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""What libraries of linear algebra ask for a number of threads; more than one only wait here."""


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
    fitting.compile_kernels,
    fitting.fit,
    judging.score,
    judging.nested,
    judging.compare,
    judging.further,
    judging.predict,
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
    """Run the command line; a user's mistake ends with one message and status 1 or 2."""
    for name in SMALL_MATRICES:
        os.environ.setdefault(name, "1")
    try:
        cli.main(args=arguments, prog_name="deabayes", standalone_mode=False)
    except UserError as error:
        _end(f"deabayes: {error}", 1)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        _end("deabayes: interrupted; the same command goes on where this one stopped", 1)
    except OSError as error:
        if error.filename is None:
            raise
        _end(f"deabayes: {error.filename}: {error.strerror}", 1)
    except (Exception, SystemExit) as error:
        _end_at_an_own_model(error)
        raise


def _end_at_an_own_model(error: BaseException) -> None:
    """Report an error inside a user's own model as a user's mistake, with file and line."""
    from deabayes.own_models.loading import fault_in_a_model

    fault = fault_in_a_model(error)
    if fault is not None:
        _end(f"deabayes: {fault}", 1)


def _end(message: str, status: int) -> None:
    click.echo(message, err=True)
    sys.exit(status)


if __name__ == "__main__":
    main()
