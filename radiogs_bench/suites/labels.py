"""A row's label in LaTeX, from its plain text."""

SPECIAL = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
    ">": r"\textgreater{}", **{character: f"\\{character}" for character in "&%$#_{}"},
}  # fmt: skip


def latex_text(text: str) -> str:
    """Plain text as LaTeX prints it."""
    return "".join(SPECIAL.get(each, each) for each in text)
