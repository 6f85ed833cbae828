"""Checks that the documents' links to lines of code point at what they name; ``--write`` sets the lines anew.

A link to a line says in its title what is defined there: ``[rays](../a/rays.py#L34 "Rays.trace")``. Exit status 1 if a
line is another one, or nothing of that name is defined in the file.
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
LINK = re.compile(r'\((?P<path>[^()\s#]+\.py)#L(?P<line>\d+) "(?P<name>[\w.]+)"\)')


def definitions(tree: ast.Module | ast.ClassDef, before: str = "") -> Iterator[tuple[str, int]]:
    """Dotted names of classes, functions and methods, and the line of ``def`` or ``class``."""
    for node in tree.body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)):
            yield before + node.name, node.lineno
        if isinstance(node, ast.ClassDef):
            yield from definitions(node, f"{before}{node.name}.")


def renewed(text: str, folder: Path) -> tuple[str, list[str]]:
    """A document of ``folder`` with the lines as they are, and what was wrong with its links."""
    wrong: list[str] = []

    def line_of(link: re.Match[str]) -> str:
        file = folder / link["path"]
        lines = dict(definitions(ast.parse(file.read_text()))) if file.is_file() else {}
        if link["name"] not in lines:
            wrong.append(f"{link['path']} defines no {link['name']}")
            return link[0]
        if (line := lines[link["name"]]) != int(link["line"]):
            wrong.append(f"{link['path']}#L{link['line']}: {link['name']} is in line {line}")
        return f'({link["path"]}#L{line} "{link["name"]}")'

    return LINK.sub(line_of, text), wrong


def main(write: bool) -> int:
    """Look through all documents."""
    found: list[str] = []
    for document in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        text, wrong = renewed(document.read_text(), document.parent)
        found += [f"{document.relative_to(ROOT)}: {each}" for each in wrong]
        if write:
            document.write_text(text)
    sys.stdout.writelines(f"{line}\n" for line in [*found, f"{len(found)} links to renew"])
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main("--write" in sys.argv[1:]))
