"""``report.html``: the run as one page in a single file that needs no network and no server."""
