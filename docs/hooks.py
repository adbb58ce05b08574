"""Tables, help and code in the pages come from CSV files, the command line and notebooks."""

from __future__ import annotations

import ast
import base64
import csv
import json
import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

TABLE = re.compile(r"<!-- table: (?P<path>\S+) -->")
FIGURE = re.compile(r"<!-- figure: (?P<path>\S+) (?P<text>[^>]+?) -->")
CODE = re.compile(r"<!-- code: (?P<path>\S+)(?P<names>( \w+)*) -->")
COMMANDS = "<!-- commands -->"
SYSTEMS = "<!-- systems -->"
NOT_MEASURED = '!!! note "Not measured yet"\n    `{path}` does not exist.\n'


def on_files(files: Any, config: Any) -> Any:
    """Add a page for every notebook, with the outputs that are stored in it."""
    for path in sorted(Path(config["docs_dir"]).glob("notebooks/*.ipynb")):
        content, pictures = notebook(path)
        files.append(File.generated(config, f"notebooks/{path.stem}.md", content=content))
        for name, picture in pictures.items():
            files.append(File.generated(config, f"notebooks/{name}", content=picture))
    return files


def notebook(path: Path) -> tuple[str, dict[str, bytes]]:
    """A notebook as Markdown, and its pictures by name."""
    parts: list[str] = []
    pictures: dict[str, bytes] = {}
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for output in cell.get("outputs", []):
            shown = output.get("data", {})
            if "image/png" in shown:
                name = f"{path.stem}_{len(pictures) + 1}.png"
                pictures[name] = base64.b64decode(shown["image/png"])
                parts.append(f"![What the code above draws]({name})")
            else:
                text = "".join(output.get("text", shown.get("text/plain", "")))
                parts.append(f"```text\n{text.rstrip()}\n```")
    parts.append(f"Download [{path.name}]({path.name}), or find it in `docs/notebooks/`.")
    return "\n\n".join(parts), pictures


def on_page_markdown(markdown: str, page: Any, config: Any, **_: Any) -> str:
    """Fill the places of tables, figures (`<!-- figure: file.png text -->`), commands, systems.

    `<!-- code: file.py f g -->` quotes the functions f and g, without names the whole file.
    Paths are those below docs/, wherever the page is.
    """
    docs, folder = Path(config["docs_dir"]), posixpath.dirname(page.file.src_uri)
    markdown = TABLE.sub(lambda match: table(docs, match["path"]), markdown)
    markdown = FIGURE.sub(
        lambda match: figure(docs, match["path"], match["text"], folder), markdown
    )
    markdown = CODE.sub(lambda match: code(docs / match["path"], match["names"].split()), markdown)
    for place, made in ((COMMANDS, commands), (SYSTEMS, systems)):
        markdown = markdown.replace(place, made()) if place in markdown else markdown
    return markdown


def table(docs: Path, name: str) -> str:
    """A CSV file as a Markdown table, or a note that it was not measured."""
    path = docs / name
    if not path.is_file():
        return NOT_MEASURED.format(path=f"docs/{name}")
    with path.open(newline="", encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def figure(docs: Path, name: str, text: str, folder: str) -> str:
    """An image as a page in a folder of docs/ names it, or a note that it was not measured."""
    if not (docs / name).is_file():
        return NOT_MEASURED.format(path=f"docs/{name}")
    return f"![{text}]({posixpath.relpath(name, folder or '.')})"


def code(path: Path, names: list[str]) -> str:
    """A Python file, or functions of it, as a code block."""
    text = path.read_text(encoding="utf-8")
    found = {node.name: node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)}
    parts = [ast.get_source_segment(text, found[name]) or "" for name in names] or [text.rstrip()]
    return "```python\n" + "\n\n\n".join(parts) + "\n```"


def commands() -> str:
    """The help of every command, as the command line prints it."""
    import click

    from deabayes.cli.main import cli

    parts = []
    for name, command in sorted(cli.commands.items()):
        context = click.Context(
            command, info_name=f"deabayes {name}", max_content_width=100, terminal_width=100
        )
        parts.append(f"## `deabayes {name}`\n\n```text\n{command.get_help(context)}\n```")
    return "\n\n".join(parts)


def systems() -> str:
    """Channels and quantities of every system: SI units and meanings."""
    from deabayes.systems import REGISTRY, system_class

    parts = []
    for system in REGISTRY:
        kind = system_class(system)
        rows = [
            f"| `{name}` | {unit} | {role} | {kind.meanings.get(name, '')} |"
            for role, names in (
                ("column, drives", kind.excitations),
                ("column, responds", kind.responses),
                ("quantity", kind.required_quantities),
                ("quantity, may be given", kind.optional_quantities),
            )
            for name, unit in names.items()
        ]
        head = "| name | SI unit | is a | which is |\n| --- | --- | --- | --- |"
        parts.append("\n".join([f"**`{system}`**\n", head, *rows]))
    return "\n\n".join(parts)
