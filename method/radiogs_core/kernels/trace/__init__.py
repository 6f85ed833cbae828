"""K2: traces rays through surfels, by an eight-wide tree of boxes."""
