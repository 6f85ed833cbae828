"""What the values of a run are averages of, in plain text."""

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
    """What published values are of, and which stand apart, as they are by other conventions; one or two sentences."""
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
    """How many cells are finished, as a sentence; empty if all are."""
    finished = sum(run["state"] == "finished" for run in summary["runs"])
    return "" if finished == len(summary["runs"]) else f" {finished} of {len(summary['runs'])} cells are finished."
