"""Figures for papers and talks, as PNG and as PDF."""

from pathlib import Path

from ..summary import Summary
from .audit import audit_figure
from .canvas import Drawn, save
from .convergence import convergence_figures
from .cost import cost_figures
from .environment import environment_figures
from .finetuning import finetuning_figures
from .illumination import illumination_figures
from .knobs import knob_figures
from .ladder import ladder_figures
from .overview import overview_figures
from .qualitative import qualitative_figures
from .relighting import relighting_figures
from .stability import stability_figure

__all__ = ["Drawn", "write_figures"]


def write_figures(summary: Summary, out: Path) -> list[Drawn]:
    """Write every figure that the stored results allow into ``out``/figures; the same results give the same bytes."""
    figures = [
        *(knob_figures(summary) or cost_figures(summary)),
        *audit_figure(summary),
        *ladder_figures(summary),
        *convergence_figures(summary),
        *finetuning_figures(summary, out),
        *overview_figures(summary, out),
        *qualitative_figures(summary, out),
        *illumination_figures(summary, out),
        *environment_figures(summary, out),
        *relighting_figures(summary, out),
        *stability_figure(summary, out),
    ]
    return [save(figure, out) for figure in figures]
