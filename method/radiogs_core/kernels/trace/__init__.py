"""K2: rays through surfels, by an eight-wide tree of boxes."""
