"""Posteriors and results folders by the names that users give them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from deabayes.faults import UserError, nearest
from deabayes.posteriors.found import fitted_posteriors


def study_folders(names: Sequence[str], results: Path) -> list[Path]:
    """Results folders given as such, or as those of studies under `results`, which come first.

    Each is there once, however it is spelt.
    """
    folders = [each if (each := results / name).exists() else Path(name) for name in names]
    for name, folder in zip(names, folders, strict=True):
        if not folder.exists():
            raise _unknown(name, "results folder", results)
    once: dict[Path, Path] = {}
    for folder in folders:
        once.setdefault(folder.resolve(), folder)
    return list(once.values())


def found_posteriors(sources: Sequence[str], results: Path) -> list[Path]:
    """Posterior files given as such, or all those of one study given by name."""
    if all(Path(source).is_file() for source in sources):
        return [Path(source) for source in sources]
    if len(sources) > 1:
        missing = [source for source in sources if not Path(source).is_file()]
        raise UserError(f"{missing[0]}: no such posterior file")
    found = fitted_posteriors(results / sources[0])
    if not found:
        raise _unknown(sources[0], "posterior file", results)
    return found


def one_posterior(source: str, results: Path) -> Path:
    """A posterior file given as such, or that of a study by name with one fitted candidate."""
    if Path(source).is_file():
        return Path(source)
    found = fitted_posteriors(results / source)
    if len(found) > 1:
        files = " or ".join(map(str, found))
        raise UserError(f"study {source} has {len(found)} fitted candidates; give {files}")
    if not found and not Path(source).is_dir():  # which files a folder holds is said on opening
        raise _unknown(source, "posterior file", results)
    return found[0] if found else Path(source)


def _unknown(name: str, kind: str, results: Path) -> UserError:
    """That a name is of nothing, and of which fitted study it may be meant."""
    fitted = sorted({path.parts[-3] for path in results.glob("*/*/posterior.nc")})
    hint = nearest(name, fitted) if fitted else "; run `deabayes fit` first"
    return UserError(f"{name!r} is neither a {kind} nor a fitted study under {results}{hint}")
