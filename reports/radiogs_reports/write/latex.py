"""The table in LaTeX: booktabs, the paper's rank colours, published figures beside the measured ones."""

import re

from ..analysis.ranks import ranks
from ..summary import CellSummary, ColumnSummary, Summary
from .plain import signed_figure, unfinished

RANK_COLOURS = {1: "FF9999", 2: "FFD7D7", 3: "FFFFC7"}
"""First, second and third, as in the paper's tables."""

ARROWS = {"up": r"$\uparrow$", "down": r"$\downarrow$", "zero": r"$\to 0$"}
SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
}  # fmt: skip

BOX_BEGIN = r"\setbox0=\hbox{%"
BOX_END = (
    r"\medskip\leavevmode\ifdim\wd0>\linewidth\setbox0=\hbox{\resizebox{\linewidth}{!}{\box0}}\fi"
    "\n"
    r"\ifdim\dimexpr\ht0+\dp0\relax>0.85\textheight\setbox0=\hbox{\resizebox*{!}{0.85\textheight}{\box0}}\fi\box0"
)
"""Around a tabular: shrunk to the line's width and the page's height where it is larger, never enlarged."""

PREAMBLE = r"""\documentclass{article}
\usepackage[T1]{fontenc}
\usepackage[utf8]{inputenc}
\usepackage[landscape,margin=1.5cm]{geometry}
\usepackage{amsmath}
\usepackage{booktabs}
\usepackage[table]{xcolor}
\usepackage{graphicx}
\begin{document}
"""


GREEK = {
    character: rf"$\{name}$"
    for characters, names in (
        ("αβγδεζηθικλμνξπρστυφχψω", "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho"
         " sigma tau upsilon phi chi psi omega"),
        ("ΓΔΘΛΞΠΣΥΦΨΩ", "Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"),
    )
    for character, name in zip(characters, names.split(), strict=True)
}  # fmt: skip

SIGNS = {
    "\u00d7": r"$\times$", "±": r"$\pm$", "\u2212": r"$-$", "°": r"$^\circ$", "≤": r"$\leq$", "≥": r"$\geq$",
    "→": r"$\to$", "↑": r"$\uparrow$", "↓": r"$\downarrow$", "·": r"$\cdot$", "\u2013": "--", "—": "---",
    "…": r"\dots{}", "\u2018": "`", "\u2019": "'", "\u201c": "``", "\u201d": "''", "\u00a0": "~",
}  # fmt: skip

LATIN = range(0xC0, 0x100)
"""Letters that pdflatex prints as they are, in the T1 encoding."""


def escape(text: str) -> str:
    """Plain text as LaTeX that plain pdflatex compiles, whatever characters a name has."""
    return "".join(_escaped(character) for character in text)


def _escaped(character: str) -> str:
    known = SPECIAL.get(character) or SIGNS.get(character) or GREEK.get(character)
    if known is not None:
        return known
    if 32 <= ord(character) < 127 or ord(character) in LATIN:
        return character
    return rf"\texttt{{U+{ord(character):04X}}}"  # pdflatex has no such letter: named, never dropped


def as_formula(text: str) -> str:
    """Plain text as LaTeX in which symbols with an index, such as L_rad or N_g, are set as the paper sets them."""
    parts = re.split(r"(?<![A-Za-z])([LλN])_([A-Za-z]+)(?:\^([A-Za-z]+))?", text)
    made = escape(parts[0])
    for symbol, lower, upper, rest in zip(parts[1::4], parts[2::4], parts[3::4], parts[4::4], strict=True):
        base = {"λ": r"\lambda"}.get(symbol, symbol)
        raised = "" if upper is None else rf"^\mathrm{{{upper}}}"
        made += rf"${base}_\mathrm{{{lower}}}{raised}$" + escape(rest)
    return made


def document(summary: Summary) -> str:
    """A document of its own around ``table``; compiles with pdflatex as it is."""
    return f"{PREAMBLE}{table(summary)}\\end{{document}}\n"


def table(summary: Summary) -> str:
    """The table environment, to be included where booktabs, graphicx and xcolor (option ``table``) are loaded.

    Under each mean stands its paired difference to the reference row with the half-width of the 95 % interval;
    beside it, in grey, the published figure. A figure that does not exist is n/a, with its reason in a note.
    """
    notes: list[str] = []
    placed = {column["key"]: ranks(summary, column) for column in summary["columns"]}
    heads = " & ".join(f"{escape(column['label'])} {ARROWS[column['direction']]}" for column in summary["columns"])
    units = " & ".join(escape(column["unit"]) for column in summary["columns"])
    lines = [
        f"% {escape(summary['suite'])}: made by radiogs-bench from the results {', '.join(summary['keys'])}",
        r"\begin{table}[t]",
        r"\centering",
        f"\\caption{{{_caption(summary)}}}",
        f"\\label{{tab:{summary['suite']}}}",
        BOX_BEGIN,
        f"\\begin{{tabular}}{{l{'c' * len(summary['columns'])}r}}",
        r"\toprule",
        f"Method & {heads} & Training \\\\",
        f" & {units} & s \\\\",
        r"\midrule",
    ]
    for row in summary["rows"]:
        upper, lower = [row["latex"]], [""]
        for column in summary["columns"]:
            cell = summary["cells"][row["key"]][column["key"]]
            published = summary["published"].get(row["key"], {}).get(column["key"])
            upper.append(_figure(cell, column, placed[column["key"]].get(row["key"]), published, notes))
            lower.append(_difference(cell, column))
        seconds = "" if row["seconds"] is None else f"{row['seconds']:.0f}"
        lines.append(f"{' & '.join(upper)} & {seconds} \\\\")
        if any(lower):
            lines.append(f"{' & '.join(lower)} & \\\\")
    lines += [r"\bottomrule", r"\end{tabular}}", BOX_END]
    lines += [rf"\par\smallskip\footnotesize {note_mark(place)} {escape(note)}" for place, note in enumerate(notes)]
    return "\n".join([*lines, r"\end{table}", ""])


def _figure(
    cell: CellSummary, column: ColumnSummary, rank: int | None, published: float | None, notes: list[str]
) -> str:
    beside = "" if published is None else rf"~\textcolor{{gray}}{{({published:.{column['decimals']}f})}}"
    if cell["mean"] is None:
        reason = cell["reason"] or "not measured"
        if reason not in notes:
            notes.append(reason)
        return f"n/a{note_mark(notes.index(reason))}{beside}"
    colour = rf"\cellcolor[HTML]{{{RANK_COLOURS[rank]}}}" if rank in RANK_COLOURS else ""
    return f"{colour}{cell['mean']:.{column['decimals']}f}{beside}"


def _difference(cell: CellSummary, column: ColumnSummary) -> str:
    difference = cell["difference"]
    if difference is None:
        return ""
    text = signed_figure(difference["mean"], column["decimals"])
    if difference["low"] is not None and difference["high"] is not None:
        reach = (difference["high"] - difference["low"]) / 2
        text = rf"{text} \pm {reach:.{column['decimals']}f}"
    return rf"\scriptsize ${text}$"


def _caption(summary: Summary) -> str:
    reference = [row["latex"] for row in summary["rows"] if row["key"] == summary["reference"]]
    differences = (
        f" Below each figure: paired difference to {reference[0]} and the half-width of its 95\\,\\% $t$ interval."
        if reference
        else ""
    )
    ranked = " First to third in colour." if reference else ""
    seeds, scenes = len(summary["seeds"]), ", ".join(summary["scenes"])
    published = (
        f" In grey: published ({escape(summary['published_data'])}), at another scale, on other data."
        if summary["published"]
        else ""
    )
    return (
        f"{escape(summary['title'])}. Mean over {seeds} seed{'' if seeds == 1 else 's'} on {escape(scenes)}; preset"
        f" {escape(summary['preset'])}; metric protocol {escape(summary['protocol'])}.{unfinished(summary)}"
        f"{differences}{published}{ranked}"
    )


def note_mark(place: int) -> str:
    """The mark of the note at a place: a to z, then aa and so on."""
    letters = chr(ord("a") + place % 26)
    return rf"$^{{{letters * (1 + place // 26)}}}$"
