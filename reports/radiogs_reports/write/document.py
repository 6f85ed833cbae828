"""One LaTeX document of everything: the suite's table, the paper's tables, the figures."""

from collections.abc import Sequence

from ..summary import Summary
from .latex import PREAMBLE, escape

END = "\\end{document}\n"


def report_document(summary: Summary, tables: Sequence[str], figures: Sequence[tuple[str, str]]) -> str:
    """The document; ``tables`` are files to input, ``figures`` files to include with their captions (plain text).

    Paths are relative to the folder that the document lies in. Compiles with plain pdflatex, in one pass but for
    references.
    """
    parts = [PREAMBLE, f"% {escape(summary['title'])}\n"]
    parts += [f"\\input{{{name}}}\n\\clearpage\n" for name in tables]
    for name, caption in figures:
        parts.append(
            "\\begin{figure}[p]\n\\centering\n"
            f"\\includegraphics[width=\\linewidth,height=0.85\\textheight,keepaspectratio]{{{name}}}\n"
            f"\\caption{{{escape(caption)}}}\n\\end{{figure}}\n\\clearpage\n"
        )
    return "".join([*parts, END])
