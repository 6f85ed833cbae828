"""Hooks of mkdocs beyond mkdocs.yml: README.md is the front page, records are whole, and sources are named.

A page of the site cannot lead to files outside of docs/: such a link becomes its text, with the file as a tooltip.
"""

import html
import re
from pathlib import Path, PurePosixPath
from typing import Any

from mkdocs.structure.files import File

from radiogs_bench.results.records import RECORDS, read_record
from radiogs_reports.write.record import record_document

ROOT = Path(__file__).parents[1]
LINK = re.compile(r"(?<!!)\[(?P<text>[^\]]+)\]\((?P<target>[^)\s]+)(?:\s+\"(?P<title>[^\"]*)\")?\)")
FRONT = "index.md"


def on_files(files: Any, config: Any) -> Any:
    """Add the front page, README.md, whose links begin in the folder above, and the whole documents of the records in
    place of their pages."""
    front = re.sub(r"\]\(docs/", "](", (ROOT / "README.md").read_text(encoding="utf-8"))
    whole = {f"records/{path.stem}.md": record_document(read_record(path)) for path in sorted(RECORDS.glob("*.json"))}
    for name, text in (whole | {FRONT: front}).items():
        if (page := files.get_file_from_path(name)) is not None:
            files.remove(page)
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Replace links that leave the site."""
    here = PurePosixPath(page.file.src_uri).parent

    def replaced(match: re.Match[str]) -> str:
        target = match["target"]
        if re.match(r"[a-z]+:|#", target):
            return match[0]
        place = _joined(here, target.partition("#")[0])
        if files.get_file_from_path(place) is not None:
            return match[0]
        named = place.removeprefix("../") + (f": {match['title']}" if match["title"] else "")
        return f'<abbr title="{html.escape(named)}">{match["text"]}</abbr>'

    return LINK.sub(replaced, markdown)


def _joined(folder: PurePosixPath, target: str) -> str:
    """A path below docs/, as mkdocs names its files; what lies outside keeps its ``..``."""
    parts: list[str] = []
    for part in (folder / target).parts:
        if part == ".." and parts and parts[-1] != "..":
            parts.pop()
        elif part != ".":
            parts.append(part)
    return "/".join(parts)
