"""Symbols in labels, such as L_rad and N_g, as HTML."""

from markupsafe import Markup, escape

from ..wording import SYMBOL


def formula(text: str) -> Markup:
    """Plain text as HTML, with indices and exponents set as such.

    >>> formula("λ_rad < L_G^PBR")
    Markup('<i>λ</i><sub>rad</sub> &lt; <i>L</i><sub>G</sub><sup>PBR</sup>')
    """
    parts = SYMBOL.split(text)
    made = escape(parts[0])
    for symbol, lower, upper, rest in zip(parts[1::4], parts[2::4], parts[3::4], parts[4::4], strict=True):
        raised = Markup("") if upper is None else Markup("<sup>{}</sup>").format(upper)
        made += Markup("<i>{}</i><sub>{}</sub>{}").format(symbol, lower, raised) + escape(rest)
    return made
