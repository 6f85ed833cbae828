r"""Whether LaTeX of a row's label is only text with formulas, by a list of allowed commands.

A label is checked by reduction: known symbols become one letter each, then groups without groups within do, and so
on outwards; what is left is text, with formulas of letters and scripts between dollars.
"""

import re

GREEK = {
    character: rf"$\{name}$"
    for characters, names in (
        ("αβγδεζηθικλμνξπρστυφχψω", "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho"
         " sigma tau upsilon phi chi psi omega"),
        ("ΓΔΘΛΞΠΣΥΦΨΩ", "Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"),
    )
    for character, name in zip(characters, names.split(), strict=True)
}  # fmt: skip

LETTERS = (
    *(name.strip("$\\") for name in GREEK.values()), "varepsilon", "vartheta", "varphi", "ell", "infty", "partial",
    "nabla", "times", "cdot", "pm", "mp", "leq", "geq", "approx", "sim", "to", "rightarrow", "leftarrow", "uparrow",
    "downarrow", "circ", "star", "dagger", "propto", "in",
)  # fmt: skip
"""Commands without an argument that may be an index or an exponent without braces."""

WIDE = ("sum", "prod", "neq", "int", "max", "min", "log", "exp", "sin", "cos", "quad", "ldots", "cdots", "dots")
"""Commands without an argument that need braces as an index or exponent."""

FONTS = ("mathbf", "mathrm", "mathcal", "mathit", "mathsf", "mathtt")
ACCENTS = ("hat", "bar", "tilde", "vec", "sqrt", "boldsymbol")

LETTER, BOX = "\0", "\1"
"""Symbols and groups become these characters, which no label has."""

TEXT = r"""(?:[A-Za-z0-9À-ÖØ-öø-ÿ !"'()*+,\-./:;<=>?@\[\]|]|\\[,%&#_])"""
SCRIPT = rf"[A-Za-z0-9+\-*{LETTER}]"
TERM = (
    rf"(?: |(?:[A-Za-z0-9+\-=<>()\[\],.;:/|!*{LETTER}{BOX}]|\\[,;:!%&#_])"
    rf"(?:_{SCRIPT}(?:\^{SCRIPT})?|\^{SCRIPT}(?:_{SCRIPT})?)?)"
)

SYMBOL = re.compile(rf"\\(?:(?P<letter>{'|'.join(LETTERS)})|{'|'.join(WIDE)})(?![A-Za-z])")
GROUP = re.compile(
    rf"(?P<letter>\\(?:{'|'.join(FONTS)})\{{{TERM}*\}}|(?<![A-Za-z\\}}])\{{{TERM}*\}})"
    rf"|\\(?:{'|'.join(ACCENTS)})\{{{TERM}*\}}|\\frac\{{{TERM}*\}}\{{{TERM}*\}}|\\text\{{{TEXT}*\}}"
)
LABEL = re.compile(rf"(?![*\[])(?:{TEXT}|\${TERM}+\$)*")
"""Pattern of a label: it must not begin with a star or a bracket, which would belong to the line before."""

DEEPEST = 20
"""Deepest nesting of groups."""


def is_mathematics(latex: str) -> bool:
    r"""Whether a label is text with formulas, of commands in the list alone, which pdflatex compiles.

    >>> is_mathematics(r"$\lambda_{rad}=0$, 50\,\% of views"), is_mathematics(r"\input{/etc/hostname}")
    (True, False)
    """
    if not latex.isprintable():
        return False
    left = SYMBOL.sub(_reduced, latex)
    for _ in range(DEEPEST):
        left = GROUP.sub(_reduced, left)
    return LABEL.fullmatch(left) is not None


def _reduced(found: re.Match[str]) -> str:
    return LETTER if found["letter"] else BOX
