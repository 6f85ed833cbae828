"""LaTeX of a whole run, and parts of all reports: preamble, escapes, symbols, colours, notes, and tabulars."""

import re
from collections.abc import Mapping, Sequence

from ..analysis.findings import Sentence
from ..summary import Summary, Verdict
from ..wording import SYMBOL, mathematics
from .mathematics import GREEK, is_mathematics

COLOURS: Mapping[Verdict, str] = {"better": "CDE4F7", "worse": "FBDCC4"}
"""Blue and orange: they differ for readers who cannot tell red from green."""

ARROWS = {"up": r"$\uparrow$", "down": r"$\downarrow$", "zero": r"$\to 0$"}

BOX_BEGIN = r"\setbox0=\hbox{%"
BOX_END = (
    r"\medskip\leavevmode\ifdim\wd0>\linewidth\setbox0=\hbox{\resizebox{\linewidth}{!}{\box0}}\fi"
    "\n"
    r"\ifdim\dimexpr\ht0+\dp0\relax>0.85\textheight\setbox0=\hbox{\resizebox*{!}{0.85\textheight}{\box0}}\fi\box0"
)
"""Together with ``BOX_BEGIN``: shrinks a tabular to the line's width and the page's height, and never enlarges it."""


def tabular(layout: str, heads: Sequence[str], lines: Sequence[str]) -> list[str]:
    """A tabular of heads and lines (LaTeX), shrunk to the width of the line and the height of the page."""
    begin = rf"\begin{{tabular}}{{{layout}}}"
    return [BOX_BEGIN, begin, r"\toprule", *heads, r"\midrule", *lines, r"\bottomrule", r"\end{tabular}}", BOX_END]


LEFT = r"\par\raggedright"
"""LaTeX before the notes below a table."""

PREAMBLE = r"""\documentclass{article}
\usepackage[T1]{fontenc}
\usepackage[utf8]{inputenc}
\IfFileExists{lmodern.sty}{\usepackage{lmodern}}{}
\usepackage[margin=1.8cm]{geometry}
\usepackage{amsmath}
\usepackage{booktabs}
\usepackage{siunitx}
\usepackage[table]{xcolor}
\usepackage{graphicx}
\extrafloats{400}
\maxdeadcycles=400
\setcounter{topnumber}{9}
\setcounter{totalnumber}{9}
\renewcommand{\topfraction}{0.95}
\renewcommand{\textfraction}{0.05}
\renewcommand{\floatpagefraction}{0.6}
\makeatletter
\setlength{\@fptop}{0pt}
\setlength{\@fpsep}{20pt}
\setlength{\@fpbot}{0pt plus 1fil}
\makeatother
\setlength{\floatsep}{20pt}
\begin{document}
"""
"""Portrait pages with as many tables and figures each as fit, from the top; outlines in place of bitmap fonts."""

END = "\\end{document}\n"

SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
}  # fmt: skip

SIGNS = {
    "\u00d7": r"$\times$", "±": r"$\pm$", "\u2212": r"$-$", "°": r"$^\circ$", "≤": r"$\leq$", "≥": r"$\geq$",
    "→": r"$\to$", "↑": r"$\uparrow$", "↓": r"$\downarrow$", "·": r"$\cdot$", "\u2013": "--", "—": "---",
    "†": r"$^\dagger$", "‡": r"$^\ddagger$", "§": r"$^\S$", "¶": r"$^\P$",
    "…": r"\dots{}", "\u2018": "`", "\u2019": "'", "\u201c": "``", "\u201d": "''", "\u00a0": "~",
}  # fmt: skip

KNOWN = GREEK | SIGNS | SPECIAL

LATIN = range(0xC0, 0x100)
"""Letters that pdflatex prints as they are, in the T1 encoding."""


def escape(text: str) -> str:
    """Plain text as LaTeX that pdflatex compiles, whatever characters it has.

    A bracket or star in front would belong to the end of the line before, in a table.
    """
    guard = "{}" if text.startswith(("[", "*")) else ""
    return guard + "".join(KNOWN.get(each) or _printed(each) for each in text)


def _printed(character: str) -> str:
    if 32 <= ord(character) < 127 or ord(character) in LATIN:
        return character
    return rf"\texttt{{U+{ord(character):04X}}}"  # pdflatex has no glyph for it: print its code point, drop nothing


def as_formula(text: str) -> str:
    """Plain text as LaTeX with symbols such as L_rad and N_g set as the paper sets them."""
    parts = SYMBOL.split(text)
    made = escape(parts[0])
    for symbol, lower, upper, rest in zip(parts[1::4], parts[2::4], parts[3::4], parts[4::4], strict=True):
        made += mathematics(symbol, lower, upper) + escape(rest)
    return made


def label_of(latex: str, text: str) -> str:
    """A label in LaTeX; its escaped plain text if it has no LaTeX, or LaTeX other than text and mathematics."""
    return latex if latex and is_mathematics(latex) else as_formula(text)


MINUS = "\u2212"

HYPHEN = re.compile(r"(?<![\w.])-(?=\d)")
"""The sign of a number, after which a line must not break."""

TOGETHER = 20
"""Most figures between two page breaks: LaTeX holds back figures without a page, and stops at too many."""


def found_in(findings: Sequence[Sentence]) -> list[str]:
    """The findings of a table as sentences."""
    return [f"{label_of(each.latex, each.row)}, " * bool(each.row) + negative(each.text) for each in findings]


def negative(text: str) -> str:
    """Plain text as LaTeX whose negative numbers keep their sign."""
    return as_formula(HYPHEN.sub(MINUS, text))


def text_below(label: str, sentences: Sequence[str]) -> list[str]:
    """Sentences (LaTeX) to the table of a label, as text that a page can break; nothing without any."""
    if not sentences:
        return []
    return [
        r"\par{\footnotesize\setlength{\parindent}{0pt}\setlength{\parskip}{3pt}\raggedright",
        rf"To Table~\ref{{{label}}}:",
        *(rf"\par {each}" for each in sentences),
        r"\par}",
    ]


def colour_of(verdict: Verdict | None) -> str:
    """The cell colour of a value that is resolved to be better or worse than the reference row's; else empty."""
    return "" if verdict is None else rf"\cellcolor[HTML]{{{COLOURS[verdict]}}}"


def legend(sentences: Sequence[str]) -> list[str]:
    """The sentences below a table, a paragraph each; the colours are shown in front."""
    swatches = " ".join(rf"\colorbox[HTML]{{{code}}}{{{verdict}}}" for verdict, code in COLOURS.items())
    shown = [f"{swatches} {as_formula(sentences[0])}", *map(as_formula, sentences[1:])] if sentences else []
    return [rf"\par\smallskip\footnotesize {each}" for each in shown]


def note_mark(index: int) -> str:
    """The superscript of a note: a to z, then aa and so on."""
    letters = chr(ord("a") + index % 26)
    return rf"$^{{{letters * (1 + index // 26)}}}$"


def document(*parts: str) -> str:
    """A complete document around parts of LaTeX, which pdflatex compiles."""
    return "".join([PREAMBLE, *parts, END])


def report_document(summary: Summary, tables: Sequence[str], figures: Sequence[tuple[str, str]]) -> str:
    """A document that inputs the ``tables`` (file names) and includes the ``figures`` (file names, plain captions).

    File names are relative to the document's folder. Tables and figures share pages, in their order. Compiles with
    pdflatex, in one pass but for references.
    """
    parts = [f"% {escape(summary['title'])}\n"]
    parts += [f"\\input{{{name}}}\n" for name in tables]
    for place, (name, caption) in enumerate(figures, start=1):
        parts.append(
            "\\begin{figure}[tbp]\n\\centering\n"
            f"\\includegraphics[width=\\linewidth,height=0.4\\textheight,keepaspectratio]{{{name}}}\n"
            f"\\caption{{{escape(caption)}}}\n\\end{{figure}}\n"
        )
        parts += ["\\clearpage\n"] * (place % TOGETHER == 0)
    return document(*parts)
