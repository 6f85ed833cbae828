"""Where a page's values come from: when and by which code they were made, how to repeat them, which files hold them."""

import shlex
from typing import Any

from ..summary import Summary
from ..wording import count_of

SHORT = 10
"""Characters of a commit."""


def origin(summary: Summary) -> dict[str, str]:
    """Dates, commits and command of the run, by heading; without those that are not known."""
    sessions = [session for run in summary["runs"] for each in run["sessions"].values() for session in each]
    days = sorted({session["date"][:10] for session in sessions if session.get("date")})
    commits = sorted({_commit(session["git"]) for session in sessions if session.get("git")})
    more = f" and {count_of(len(commits) - 2, 'other')}" if commits[2:] else ""
    found = {
        "Date": " to ".join(dict.fromkeys((*days[:1], *days[-1:]))),
        "Commit": ", ".join(commits[:2]) + more,
        "Command": command(summary),
    }
    return {heading: text for heading, text in found.items() if text}


def _commit(git: dict[str, Any]) -> str:
    return str(git["commit"])[:SHORT] + (" with changes" if git.get("dirty") else "")


def command(summary: Summary) -> str:
    """The command that asked for the run; where it was not kept, one for a suite and scenes of these names."""
    if summary.get("command"):
        return shlex.join(["radiogs-bench", *summary["command"]])
    words = [
        "radiogs-bench", "run", summary["suite"], "--scenes", ",".join(summary["scenes"]),
        "--seeds", str(len(summary["seeds"])), "--preset", summary["preset"], "--protocol", summary["protocol"],
    ]  # fmt: skip
    return shlex.join(words)


def downloads(summary: Summary) -> list[tuple[str, str]]:
    """Names of files beside the page, with what they are."""
    suite = summary["suite"]
    return [
        (f"{suite}.csv", "table as CSV"),
        (f"{suite}.md", "table as Markdown"),
        (f"{suite}.tex", "table as LaTeX"),
        ("report.tex", "all tables and figures as LaTeX"),
        ("summary.json", "all values"),
    ]
