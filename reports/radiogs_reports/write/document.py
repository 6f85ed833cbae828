"""One LaTeX document of the whole run: the suite's table, the paper's tables, the figures."""

from collections.abc import Sequence

from ..summary import Summary
from .latex import END, PREAMBLE, escape

TOGETHER = 20
"""Most figures that LaTeX places at once: it holds back every figure that has no page yet, and stops at too many."""


def report_document(summary: Summary, tables: Sequence[str], figures: Sequence[tuple[str, str]]) -> str:
    """A document that inputs the ``tables`` (file names) and includes the ``figures`` (file names, plain captions).

    File names are relative to the document's folder. Tables and figures share pages, in their order. Compiles with
    pdflatex, in one pass but for references.
    """
    parts = [PREAMBLE, f"% {escape(summary['title'])}\n"]
    parts += [f"\\input{{{name}}}\n" for name in tables]
    for place, (name, caption) in enumerate(figures, start=1):
        parts.append(
            "\\begin{figure}[tbp]\n\\centering\n"
            f"\\includegraphics[width=\\linewidth,height=0.4\\textheight,keepaspectratio]{{{name}}}\n"
            f"\\caption{{{escape(caption)}}}\n\\end{{figure}}\n"
        )
        parts += ["\\clearpage\n"] * (place % TOGETHER == 0)
    return "".join([*parts, END])
