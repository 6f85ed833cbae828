"""A page opened in headless Chromium, which must log no message and make no request."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from made_up_run import summary
from radiogs_reports.summary import Summary

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (extra dev)")
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
needed = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (make extras)")

DESK, PHONE = {"width": 1280, "height": 900}, {"width": 390, "height": 844}
OF_SCREENSHOTS = "GPU stall due to ReadPixels"
"""A message of Chromium's software renderer when a test takes a screenshot."""


@pytest.fixture(scope="module")
def browser() -> Iterator["playwright.Browser"]:
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


class Watched:
    """An opened page, its requests, and its messages beyond the ``expected`` one."""

    def __init__(
        self, browser: "playwright.Browser", path: Path, *, expected: str = OF_SCREENSHOTS, **settings: object
    ) -> None:
        self.said: list[str] = []
        self.expected = (OF_SCREENSHOTS, expected)
        self.asked: list[str] = []
        self.page = browser.new_page(**settings)
        self.page.set_default_timeout(10_000)
        self.page.on("console", lambda message: self.heard(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(path.as_uri())
        self.own = path.as_uri()

    def heard(self, text: str) -> None:
        if not any(part in text for part in self.expected):
            self.said.append(text)

    def column(self, table: str, place: int) -> list[str]:
        return self.page.eval_on_selector_all(
            f'table[data-name="{table}"] tbody tr',
            f"rows => rows.map(row => row.cells[{place}].firstChild.textContent)",
        )

    def close(self) -> None:
        """Leave, having checked that the page was quiet."""
        self.page.close()
        assert self.said == [], self.said
        beside = self.own.removesuffix("report.html") + "report_files/"
        inside = (self.own, "data:", beside)
        assert [url for url in self.asked if not url.startswith(inside)] == []


def made_up() -> Summary:
    made = summary()
    made["rows"].append({"key": "third", "latex": "Third", "text": "third", "seconds": 9.5})
    made["cells"]["third"] = {
        key: {**value, "mean": None, "difference": None} for key, value in made["cells"]["ours"].items()
    }
    made["cells"]["third"]["normal/mae"] = {"mean": 11.0, "count": 1, "difference": None, "reason": None}
    made["published"]["third"] = {"nvs/psnr": 40.0}
    return made
