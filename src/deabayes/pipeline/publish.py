"""From results to what people look at: figures, the report, other programs' formats."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from deabayes.pipeline.as_fitted import check_as_fitted

if TYPE_CHECKING:
    from deabayes.report.notices import Notice


def draw_figures(results: Path, output: Path) -> None:
    """Draw every registered figure of a study."""
    from deabayes.figures import save_all

    check_as_fitted(results)
    save_all(results, output)


def build_report(
    folders: Sequence[Path],
    output: Path,
    tables: Path,
    left_out: Sequence[str],
    failed: Sequence[Notice] = (),
) -> None:
    """Build the report page and its tables; `failed` is what a run could not make."""
    from deabayes.report import build

    for folder in folders:
        check_as_fitted(folder)
    build(folders, output, tables, left_out, failed)


def export_posterior(
    posterior: Path, to: str, output: Path, **options: object
) -> tuple[bool, list[str]]:
    """Write a posterior in another program's format, which may take options.

    Returns whether it converged, which not every format can say, and what is to be heeded.
    """
    from deabayes.export import export
    from deabayes.posteriors.storage import read_tree

    tree = read_tree(posterior)
    cautions = export(tree, to, output, **options)
    return bool(json.loads(tree.attrs["convergence"])["converged"]), cautions
