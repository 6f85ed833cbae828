"""What the values of a run are averages of, in plain text."""

from ..summary import Summary
from ..wording import count_of


def run_note(summary: Summary) -> str:
    """Scenes, seeds, preset, protocol, source of published values, machine."""
    return (
        f"Mean over {count_of(len(summary['scenes']), 'scene')} ({', '.join(summary['scenes'])}) and"
        f" {count_of(len(summary['seeds']), 'seed')}; preset {summary['preset']}; metric protocol"
        f" {summary['protocol']}.{unfinished(summary)} Published values: {summary['published_data']}."
        f" Machine: {summary['machine']}."
    )


def unfinished(summary: Summary) -> str:
    """How many cells are finished, as a sentence; empty if all are."""
    finished = sum(run["state"] == "finished" for run in summary["runs"])
    return "" if finished == len(summary["runs"]) else f" {finished} of {len(summary['runs'])} cells are finished."
