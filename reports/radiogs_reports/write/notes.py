"""Notes below a table: each text once, in the order of first use."""


def note_index(notes: list[str], text: str) -> int:
    """Index of a note, which is appended to ``notes`` if it is new."""
    if text not in notes:
        notes.append(text)
    return notes.index(text)
