"""Commands that weigh candidates against each other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from deabayes.commands.options import CONFIG, EXISTING, RESULTS, TARGET
from deabayes.commands.output import keep_inputs


@click.command()
@click.argument("posterior", type=EXISTING)
@click.option("--prepared", type=EXISTING, required=True)
@click.option("-o", "--output", type=TARGET, required=True, help="scores.json")
def score(posterior: Path, prepared: Path, output: Path) -> None:
    """Evidence, BIC and leave-one-experiment-out score of one posterior."""
    from deabayes.pipeline import score_candidate

    keep_inputs(output, posterior)
    for line in score_candidate(posterior, prepared, output):
        click.echo(line)


@click.command()
@click.argument("posterior", type=EXISTING)
@click.option("--prepared", type=EXISTING, required=True)
@click.option("-o", "--output", type=TARGET, required=True, help="nested.json")
def nested(posterior: Path, prepared: Path, output: Path) -> None:
    """Evidence by nested sampling, to check that of `score`; needs the package dynesty."""
    from deabayes.pipeline import check_evidence

    keep_inputs(output, posterior)
    check_evidence(posterior, prepared, output)


@click.command()
@click.argument("posteriors", nargs=-1, required=True)
@RESULTS
@click.option("--prepared", type=EXISTING, help="Default: prepared/ of the posteriors' study.")
@click.option("-o", "--output", type=TARGET, help="Default: comparison.csv of the study.")
def compare(
    posteriors: Sequence[str], results: Path, prepared: Path | None, output: Path | None
) -> None:
    """Rank candidates: POSTERIORS are files, or the name of one fitted study.

    Candidates that did not converge are listed, and not ranked.
    """
    from deabayes.commands.by_hand import compare_posteriors

    click.echo(compare_posteriors(posteriors, results, prepared, output))


@click.command()
@click.argument("results", type=EXISTING)
@CONFIG
@click.option("--asked", help="further_experiments as YAML; default: those of the config's study.")
@click.option("-o", "--output", type=TARGET, help="Default: further_experiments.csv in RESULTS.")
def further(results: Path, config: Path, asked: str | None, output: Path | None) -> None:
    """Weigh experiments that could be done next, from one study's results (results/NAME).

    How surely would each tell the candidates apart that the records leave in the running, and
    how much would it tell about their parameters? Considered are the held-out records and what
    the study asks for under further_experiments.
    """
    from deabayes.commands.by_hand import weigh_experiments

    click.echo(weigh_experiments(results, config, asked, output), nl=False)
