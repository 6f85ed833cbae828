"""``report.html``: a run to look at, in one file that needs no network and no server."""

from .assemble import write_page

__all__ = ["write_page"]
