"""Marks beside uncertain values, and the footnotes with the reasons."""

from ..summary import Doubt, Interval, Summary, Verdict, is_doubted

MARKS = "†‡§¶"
"""In the order of the footnotes; the fifth footnote has the first mark twice, and so on."""


def marks(summary: Summary, row: str, column: str) -> str:
    """The marks of a value; empty for one without a footnote."""
    noted = enumerate(_of_columns(summary))
    return "".join(_mark(place) for place, doubt in noted if doubt["column"] == column and row in doubt["rows"])


def shown_verdict(summary: Summary, row: str, column: str, difference: Interval | None) -> Verdict | None:
    """The verdict that a table shows; None if a footnote concerns the value or the reference row's value."""
    return None if difference is None or is_doubted(summary, row, column) else difference["verdict"]


def footnotes(summary: Summary) -> list[str]:
    """Every footnote behind its mark."""
    return [f"{_mark(place)} {doubt['text']}" for place, doubt in enumerate(_of_columns(summary))]


def remarks(summary: Summary) -> list[str]:
    """Doubts that concern no column, such as a method's differences from the published method of its name."""
    return [doubt["text"] for doubt in summary.get("doubts", []) if not doubt["column"]]


def texts_of(summary: Summary, row: str, column: str) -> str:
    """The footnotes of a value, without marks."""
    return " ".join(each["text"] for each in _of_columns(summary) if each["column"] == column and row in each["rows"])


def _of_columns(summary: Summary) -> list[Doubt]:
    return [doubt for doubt in summary.get("doubts", []) if doubt["column"]]


def _mark(place: int) -> str:
    return MARKS[place % len(MARKS)] * (1 + place // len(MARKS))
