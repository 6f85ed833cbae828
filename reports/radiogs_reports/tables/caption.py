"""The conditions of a run in plain text: scenes, seeds and protocol, and the sources of its values."""

import shlex

from ..summary import Summary, protocol_title
from ..wording import count_of, mean_over


def run_note(summary: Summary) -> str:
    """Scenes, seeds, preset, recipe, protocol, source of published values, machine."""
    return (
        f"Mean over {mean_over(summary)}; {preset_and_recipe(summary)}; metric protocol {protocol_title(summary)}."
        f"{unfinished(summary)} {published_note(summary)} Machine: {summary['machine']}."
    )


def preset_and_recipe(summary: Summary) -> str:
    """The preset, and the recipe with its division where one was named."""
    recipe = f"; recipe {summary['recipe']} ({division(summary['recipe'])} division)" if "recipe" in summary else ""
    return f"preset {summary['preset']}{recipe}"


def division(recipe: str) -> str:
    """``closed`` where a recipe has the paper's values and length, else ``open``."""
    return "closed" if recipe == "printed" or recipe.startswith("printed, closed") else "open"


def published_note(summary: Summary) -> str:
    """The data that published values are of, and the columns whose published values are by other conventions."""
    keys = {key for row in summary["published"].values() for key in row}
    of_columns = [column for column in summary["columns"] if column["key"] in keys]
    apart = [column for column in of_columns if "published_by" in column]
    text = f"Published values: {summary['published_data']}."
    if not apart:
        return text
    which = "all" if len(apart) == len(of_columns) else ", ".join(column["label"] for column in apart)
    by = ", ".join(sorted({column["published_by"] for column in apart}))
    return (
        f"{text} By protocol {by}, whose conventions are others ({which}): those are in tables of their own, and beside"
        f" the measured ones in a run with --protocol {by}."
    )


def unfinished(summary: Summary) -> str:
    """The number of finished cells and of scenes that are left out, as sentences; empty if all cells are finished."""
    finished, count = sum(run["state"] == "finished" for run in summary["runs"]), len(summary["runs"])
    cells = "" if finished == count else f" {finished} of {count} cells are finished."
    left = len(summary.get("left_out", []))
    return cells + (f" {left} of the run's {len(summary['scenes']) + left} scenes are left out." if left else "")


ORIGIN = ("Date", "Commit", "Version", "Command")
"""The headings of ``origin``, in their order."""

SHORT = 10
"""Characters of a commit's hash that are shown."""


def origin(summary: Summary) -> dict[str, str]:
    """Dates, commits (else versions of the package) and command of the run, by heading, where they are known."""
    sessions = [session for run in summary["runs"] for each in run["sessions"].values() for session in each]
    days = sorted({session["date"][:10] for session in sessions if session.get("date")})
    known = [session["git"] for session in sessions if session.get("git")]
    commits = sorted({f"{git['commit'][:SHORT]}{' with changes' if git.get('dirty') else ''}" for git in known})
    more = f" and {count_of(len(commits) - 2, 'other')}" if commits[2:] else ""
    versions = sorted({found for session in sessions if (found := session.get("versions", {}).get("radiogs-bench"))})
    texts = (
        " to ".join(dict.fromkeys((*days[:1], *days[-1:]))),
        ", ".join(commits[:2]) + more,
        "" if commits else ", ".join(versions),
        command(summary),
    )
    return {heading: text for heading, text in zip(ORIGIN, texts, strict=True) if text}


def command(summary: Summary) -> str:
    """The command that asked for the run; if it was not stored, a command for a suite and scenes of these names."""
    if summary.get("command"):
        return shlex.join(["radiogs-bench", *summary["command"]])
    words = [
        "radiogs-bench", "run", summary["suite"], "--scenes", ",".join(summary["scenes"]),
        "--seeds", str(len(summary["seeds"])), "--preset", summary["preset"], "--protocol", summary["protocol"],
    ]  # fmt: skip
    return shlex.join(words)
