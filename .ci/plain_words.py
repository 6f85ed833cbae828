"""Checks how sentences open in docstrings, comments, the help texts of the command line and documents.

    python .ci/plain_words.py

A sentence that opens with "Of", "What", "That of", "Those of" or "The same of" leaves out its subject or its verb, and
only a reader of the code can supply it. A question that ends with "?" may open with "What". The check reads the
docstrings of modules, classes, functions and attributes (a text that follows an assignment), comments that stand alone
on their lines, the texts given as ``help=`` and ``description=``, and paragraphs and lists of Markdown. It prints every
finding as ``file:line``; the exit code is 1 if there is any.
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("method", "datasets", "baselines", "reports", "radiogs_bench", "tests", ".ci")
DOCUMENTS = ("*.md", "docs/*.md")

OPENING = re.compile(r"[\"'`(*-]*\s*(Of|What|That of|Those of|The same of)\b(?!-)")
"""A forbidden opening, after quotes, a bracket or the dash of a list."""

SENTENCE = re.compile(r"\S.*?(?:(?<!e\.g)(?<!i\.e)[.!?][\"'`)\]]*(?=\s|$)|(?=\n\s*\n)|(?=\n\s*- )|$)", re.DOTALL)
"""A sentence: it ends at a mark that ends one, at an empty line, or where the next item of a list begins."""

HELP_ARGUMENTS = ("help", "description")

COMMENTS = re.compile(r"(?:^[ \t]*#(?!!).*\n?)+", re.MULTILINE)
"""Lines of comments that follow one another."""

NO_PROSE = re.compile(r"^```.*?^```|^(?: {4}| *[|#<]).*?$", re.MULTILINE | re.DOTALL)
"""Blocks of code, lines of tables, headings and marks of a document."""


def checked_texts(tree: ast.Module) -> Iterator[ast.Constant]:
    """The docstrings of a module and of everything in it, and the texts that its calls give as help."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.value
        for argument in node.keywords if isinstance(node, ast.Call) else ():
            if argument.arg in HELP_ARGUMENTS:
                for part in ast.walk(argument.value):
                    if isinstance(part, ast.Constant) and isinstance(part.value, str):
                        yield part


def findings(source: str, name: str) -> list[str]:
    """``name:line: sentence`` for each sentence of a module that has a forbidden opening, in the order of lines.

    Raises SyntaxError if ``source`` is not Python.
    """
    found = [each for text in checked_texts(ast.parse(source)) for each in openings(text.value, text.lineno)]
    for comment in COMMENTS.finditer(source):
        text = re.sub(r"^[ \t]*#", "", comment[0], flags=re.MULTILINE)
        found += openings(text, 1 + source.count("\n", 0, comment.start()))
    return [f"{name}:{line}: {sentence}" for line, sentence in sorted(found)]


def document_findings(text: str, name: str) -> list[str]:
    """``name:line: sentence`` for each sentence of a document that has a forbidden opening."""
    prose = NO_PROSE.sub(lambda part: re.sub(r".", " ", part[0]), text)
    return [f"{name}:{line}: {sentence}" for line, sentence in openings(prose, 1)]


def openings(text: str, first: int) -> list[tuple[int, str]]:
    """Line and text of each sentence with a forbidden opening; ``first``: the number of the text's first line."""
    return [
        (first + text.count("\n", 0, sentence.start()), " ".join(sentence[0].split()))
        for sentence in SENTENCE.finditer(text)
        if OPENING.match(sentence[0]) and not sentence[0].rstrip("\"'`)]").endswith("?")
    ]


def main(root: Path = ROOT) -> int:
    """Check every Python file of FOLDERS and every document under ``root``; 1 if there is any finding."""
    files = sorted(file for folder in FOLDERS for file in (root / folder).rglob("*.py"))
    found = [each for file in files for each in findings(file.read_text(), str(file.relative_to(root)))]
    for file in sorted(file for pattern in DOCUMENTS for file in root.glob(pattern)):
        found += document_findings(file.read_text(encoding="utf-8"), str(file.relative_to(root)))
    sys.stdout.writelines(f"{line}\n" for line in [*found, f"{len(found)} sentences with a forbidden opening"])
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
