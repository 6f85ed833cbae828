"""Text that was stored by a stranger commands no terminal, whichever command prints it."""

import io
import json
import logging
import re
from pathlib import Path
from unittest.mock import patch

import pytest
from rich.table import Table

from bench.fake_method import FAKE, finished_sweep
from radiogs_bench.cli import main, reporter
from radiogs_bench.methods import substitutes
from radiogs_bench.runs.progress import LogProgress, TextConsole
from radiogs_bench.store.seal import sealed

HOSTILE = "\x1b[2J\x1b]0;owned\x07\x1b[32msound\u202e\x9b2J"
COLOURS = re.compile(r"\x1b\[[0-9;]*m")


def commands_nothing(text: str) -> bool:
    return all(each.isprintable() for each in text.replace("\n", "").replace("\t", ""))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run with such a title and such names of rows, sealed by whoever made it."""
    folder = finished_sweep(tmp_path_factory.mktemp("run"))
    sweep = json.loads((folder / "sweep.json").read_bytes())
    sweep["title"] = HOSTILE
    for row in sweep["rows"]:
        row["text"] = f"{row['text']} {HOSTILE}"
    (folder / "sweep.json").write_text(json.dumps(sealed(sweep)))
    return folder


@pytest.mark.parametrize("command", ["status", "status --watch 1", "verify", "report --no-pictures", "export", "gate"])
def test_no_command_passes_it_on(command: str, run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    name, *further = command.split()
    with patch.dict(substitutes, {FAKE.name: FAKE}):
        main([name, str(run), *further])
    said = "".join(capfd.readouterr())
    assert said
    assert commands_nothing(said)
    assert ("owned" in said) == (name in ("status", "report"))


def test_a_terminal_gets_our_colours_and_none_of_the_text() -> None:
    console = TextConsole(file=io.StringIO(), force_terminal=True, color_system="standard", width=120)
    table = Table(title=HOSTILE.replace("[", r"\["))
    table.add_column("[bold red]row[/]")
    table.add_row(HOSTILE)
    console.print(table)
    said = console.file.getvalue()  # type: ignore[attr-defined]
    assert "\x1b[1;31m" in said
    assert commands_nothing(COLOURS.sub("", said))


def test_lines_of_progress_and_of_logs_are_visible(capsys: pytest.CaptureFixture[str]) -> None:
    LogProgress().say(HOSTILE)
    reporter.say(HOSTILE)
    reporter.say_whole(HOSTILE)
    reporter.complain(HOSTILE)
    try:
        raise ValueError(HOSTILE)
    except ValueError:
        reporter.complain_with_trace()
    said = "".join(capsys.readouterr())
    assert said.count("owned") == 5
    assert commands_nothing(said)
    record = logging.LogRecord("radiogs_bench", logging.WARNING, "", 0, HOSTILE, None, None)
    assert commands_nothing(reporter.VisibleFormatter().format(record))
