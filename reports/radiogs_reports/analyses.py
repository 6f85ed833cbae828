"""Every analysis of a run, in the order of the page: its files, its section, its figures and its part of a record."""

from collections.abc import Callable
from typing import NamedTuple

from .analysis.audit import audit_report
from .analysis.beside import beside_report
from .analysis.chain import chain_report
from .analysis.cost import cost_report
from .analysis.crossed import crossed_report
from .analysis.ladder import ladder_report
from .analysis.published_order import order_report
from .analysis.report import Report
from .analysis.settling import settling_report
from .figures.audit import audit_figure
from .figures.canvas import Sketch
from .figures.chain import chain_figures
from .figures.cost import cost_figures
from .figures.effect_curves import effect_curve_figures
from .figures.ladder import ladder_figures
from .summary import Summary


class Analysis(NamedTuple):
    """An analysis, and where its findings are shown."""

    key: str
    """Name of its files in OUT/tables."""
    section: str
    """Anchor of its section of the page."""
    link: str
    """Its name in the navigation of the page."""
    title: str
    report: Callable[[Summary], Report | None]
    """Makes its findings; None if the rows of a run do not allow the analysis."""
    figures: Callable[[Summary], list[Sketch]] = lambda summary: []


ANALYSES = (
    Analysis("cost", "knobs", "Knobs", "What each knob gives and takes", cost_report, cost_figures),
    Analysis("beside", "beside", "Other run", "This run beside another", beside_report),
    Analysis("settling", "settling", "Time to quality", "Time to quality", settling_report),
    Analysis("audit", "audit", "Audit", "What was left out, and what it cost", audit_report, audit_figure),
    Analysis("chain", "chain", "Steps", "What each step is worth", chain_report, chain_figures),
    Analysis(
        "crossed", "crossed", "Pairs", "What a setting is worth beside others", crossed_report, effect_curve_figures
    ),
    Analysis("ladder", "ladder", "Ladder", "What each part is responsible for", ladder_report, ladder_figures),
    Analysis("published_order", "order", "Published order", "Measured and published order", order_report),
)


def reports_of(summary: Summary) -> list[tuple[Analysis, Report]]:
    """The analyses that a run allows, with their findings."""
    return [(each, report) for each in ANALYSES if (report := each.report(summary)) is not None]
