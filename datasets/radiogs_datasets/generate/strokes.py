"""Capital letters as straight strokes, for what is printed on a surface."""

import itertools

Segment = tuple[tuple[float, float], tuple[float, float]]
"""From one end to the other, each to the right and upwards from the lower left of a text, in heights of a letter."""

WIDTH = 0.6
SPACING = 0.35
"""Of letters, and between the middles of the strokes of neighbours."""

GLYPHS = {
    "A": "00 14 20, 0B 2B",
    "D": "00 04 14 23 21 10 00",
    "F": "00 04 24, 02 12",
    "G": "23 14 03 01 10 21 22 12",
    "I": "10 14",
    "L": "04 00 20",
    "O": "10 01 03 14 23 21 10",
    "R": "00 04 14 23 12 02, 12 20",
    "S": "01 10 21 03 14 23",
    "U": "04 01 10 21 24",
}
"""Polylines on a grid three points wide and five high, as column and row from the lower left; B is a row and a half."""

ROWS = {"0": 0.0, "1": 0.25, "B": 0.375, "2": 0.5, "3": 0.75, "4": 1.0}


def segments(text: str) -> tuple[Segment, ...]:
    """The strokes of a text on one line. Raises ValueError for a letter that has none."""
    unknown = sorted(set(text) - set(GLYPHS) - {" "})
    if unknown:
        raise ValueError(f"no strokes for {', '.join(unknown)} in the text '{text}'; there are {''.join(GLYPHS)}")
    return tuple(stroke for place, letter in enumerate(text) if letter != " " for stroke in _letter(letter, place))


def _letter(letter: str, place: int) -> list[Segment]:
    left = place * (WIDTH + SPACING)
    lines = [
        [(left + int(point[0]) * WIDTH / 2, ROWS[point[1]]) for point in polyline.split()]
        for polyline in GLYPHS[letter].split(", ")
    ]
    return [pair for line in lines for pair in itertools.pairwise(line)]
