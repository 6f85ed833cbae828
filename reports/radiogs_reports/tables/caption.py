"""The conditions of a run in plain text: its scenes, seeds and protocol, and the source of published values."""

from ..summary import Summary
from ..wording import count_of


def run_note(summary: Summary) -> str:
    """Scenes, seeds, preset, protocol, source of published values, machine."""
    return (
        f"Mean over {count_of(len(summary['scenes']), 'scene')} ({', '.join(summary['scenes'])}) and"
        f" {count_of(len(summary['seeds']), 'seed')}; preset {summary['preset']}; metric protocol"
        f" {summary['protocol']}.{unfinished(summary)} {published_note(summary)}"
        f" Machine: {summary['machine']}."
    )


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
    """The number of finished cells and of scenes that are left out, as sentences; empty if everything is there."""
    finished, count = sum(run["state"] == "finished" for run in summary["runs"]), len(summary["runs"])
    cells = "" if finished == count else f" {finished} of {count} cells are finished."
    left = len(summary.get("left_out", []))
    return cells + (f" {left} of the run's {len(summary['scenes']) + left} scenes are left out." if left else "")
