"""The page's browser of images in headless Chromium: what is chosen is drawn, from inside the page or beside it."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from chromium import DESK, PHONE, Watched, browser, made_up, needed, playwright
from made_up_run import arrays, run, summary, write_run
from radiogs_reports.maps import error, false_colour, levels
from radiogs_reports.page.assemble import write_page

pytestmark = needed
__all__ = ["browser"]

PIXELS = """id => {
    const { width, height, hidden } = document.getElementById(id);
    const copy = new OffscreenCanvas(width, height).getContext('2d', { willReadFrequently: true });
    copy.drawImage(document.getElementById(id), 0, 0);
    return hidden ? null : [...copy.getImageData(0, 0, width, height).data];
}"""


@pytest.fixture
def opened(browser: "playwright.Browser", tmp_path: Path) -> Iterator[Watched]:
    """Two rows; a second scene of one row and one seed."""
    made = made_up()
    made["scenes"] = ["my_scene", "other"]
    made["runs"].append(run("ours", "other", 0, "456", {"nvs/psnr": 29.0, "normal/mae": 7.4, "nvs/lpips": None}))
    folder = write_run(tmp_path, made)
    kept = {name: each for name, each in arrays(1).items() if name != "render/incident"}
    np.savez(folder / "cells" / "def.npz", allow_pickle=False, **kept)
    watched = Watched(browser, write_page(made, folder)[0], viewport=DESK)
    yield watched
    watched.close()


def pixels(watched: Watched, name: str) -> np.ndarray:
    """The pixels of a canvas, once every requested sheet has arrived."""
    watched.page.wait_for_function("document.querySelectorAll('#gallery canvas').length > 0")
    watched.page.evaluate("() => new Promise(done => setTimeout(done, 100))")
    return np.array(watched.page.evaluate(PIXELS, name)).reshape(16, 16, 4)[..., :3]


def choose(watched: Watched, **choices: str) -> None:
    for name, value in choices.items():
        watched.page.locator(f"#{name.replace('_', '-')}").select_option(value)


def said(watched: Watched, name: str) -> str:
    return watched.page.locator(f"#{name}").text_content() or ""


def test_the_browser_opens_with_the_shown_view_beside_its_truth(opened: Watched) -> None:
    assert opened.page.locator("#browse-view option:checked").text_content() == "test_004"
    assert np.array_equal(pixels(opened, "compare-right-image"), levels(arrays(0)["render/image"]))
    assert np.array_equal(pixels(opened, "compare-left-image"), levels(arrays(0)["truth/image"]))
    assert said(opened, "compare-left-name") == "◀ ground truth"
    assert opened.page.locator("#browse-seed").is_hidden(), "there is only one"


def test_the_canvas_shows_the_chosen_view_map_light_and_rows(opened: Watched) -> None:
    choose(
        opened,
        browse_view="2",
        browse_map="relit",
        browse_light="night",
        compare_left="row ours",
        compare_right="row no-rad",
    )
    assert np.array_equal(pixels(opened, "compare-right-image"), arrays(1)["views/2/render/relit/night"])
    assert np.array_equal(pixels(opened, "compare-left-image"), arrays(0)["views/2/render/relit/night"])
    choose(opened, browse_map="depth", compare_left="truth")
    assert np.array_equal(pixels(opened, "compare-left-image")[..., :1], arrays(0)["views/2/truth/depth"])
    choose(opened, browse_scene="other")
    assert opened.page.locator("#compare-right option").all_text_contents() == ["Ours"]
    assert opened.page.locator("#browse-map").input_value() == "depth"
    assert np.array_equal(pixels(opened, "compare-right-image")[..., :1], arrays(3)["views/2/render/depth"])


@pytest.mark.parametrize(("gain", "factor", "until"), [("1", 1, "0.25"), ("4", 4, "0.063"), ("auto", 8, "0.031")])
def test_errors_are_shown_in_false_colours_times_a_gain(
    gain: str, factor: float, until: str, browser: "playwright.Browser", tmp_path: Path
) -> None:
    """The screen has the colours of ``maps``; by ``auto`` the gain is one for all rows, by the one with most errors."""
    made = summary()
    folder = write_run(tmp_path, made)
    for place, largest in ((0, 2), (1, 5)):
        stored = arrays(place)
        truth = stored["views/2/truth/image"].clip(10)
        less = np.linspace(0, largest, 16 * 16).reshape(16, 16, 1).round().astype(np.uint8)
        stored |= {"views/2/truth/image": truth, "views/2/render/image": truth - less}
        np.savez(folder / made["runs"][place]["arrays"], allow_pickle=False, **stored)
    opened = Watched(browser, write_page(made, folder)[0], viewport=DESK)
    assert opened.page.locator("#error-gain").input_value() == "auto", "a first look shows structure"
    choose(opened, browse_view="2", browse_map="image", compare_right="row ours", error_gain=gain)
    grey = pixels(opened, "error-image")[..., :1] / 255
    expected = levels(false_colour(np.minimum(factor * grey, 1)))
    shot = np.array(Image.open(io.BytesIO(opened.page.locator("#error-stage").screenshot())).convert("RGB"))
    centres = [((np.arange(16) + 0.5) * side / 16).astype(int) for side in shot.shape[:2]]
    difference = np.abs(shot[np.ix_(*centres)].astype(int) - expected)
    assert np.quantile(difference, 0.95) <= 8
    assert said(opened, "error-unit").endswith(f"0 to {until}")
    assert f"its error times {factor} " in said(opened, "browse-said")
    opened.close()


def test_a_map_without_truth_says_so_and_has_no_error(opened: Watched) -> None:
    choose(opened, browse_map="incident")
    assert said(opened, "compare-left-name") == "◀ n/a: no ground truth for this map"
    assert opened.page.evaluate(PIXELS, "error-image") is None
    assert opened.page.locator("#error-none").is_visible()
    assert opened.page.locator("#browse-view option").all_text_contents() == ["test_004"], "of one view alone"
    assert opened.page.locator("#strip .tile").all_inner_texts()[1].split() == ["lambda_rad", "=", "0", "n/a"]
    choose(opened, compare_right="row no-rad")
    assert said(opened, "compare-right-name") == "n/a: lambda_rad = 0 has no such map ▶"


def test_arrow_keys_go_from_view_to_view_and_from_row_to_row(opened: Watched) -> None:
    stage, view = opened.page.locator("#compare-stage"), opened.page.locator("#browse-view option:checked")
    stage.press("ArrowRight")
    assert view.text_content() == "test_008"
    assert np.array_equal(pixels(opened, "compare-right-image"), arrays(0)["views/2/render/image"])
    stage.press("ArrowRight")
    assert view.text_content() == "test_000", "round from the last to the first"
    stage.press("ArrowLeft")
    stage.press("ArrowDown")
    assert opened.page.locator("#compare-right").input_value() == "row no-rad"
    assert said(opened, "compare-right-name") == "lambda_rad = 0, NVS PSNR 29.50 dB ▶"
    stage.press("+")
    stage.press("ArrowRight")  # now it moves the picture
    assert view.text_content() == "test_008"


def test_small_pictures_show_rows_views_and_maps_and_choose_by_a_click(opened: Watched) -> None:
    rows = opened.page.locator("#strip .tile")
    assert opened.page.locator("#strip .tile span:first-of-type").all_text_contents() == [
        "ground truth",
        "Ours",
        "lambda_rad = 0",
    ]
    rows.nth(2).click()
    assert opened.page.locator("#compare-right").input_value() == "row no-rad"
    tiles = opened.page.locator("#gallery .tile")
    names = opened.page.locator("#gallery .tile span:first-of-type")
    assert names.all_text_contents() == ["test_000", "test_004", "test_008"]
    tiles.nth(2).click()
    assert opened.page.locator("#browse-view").input_value() == "2"
    choose(opened, gallery_of="maps")
    assert names.all_text_contents()[-2:] == ["relit under night", "relit under sky"]
    tiles.nth(1).click()
    assert opened.page.locator("#browse-map").input_value() == "albedo"
    pressed = opened.page.eval_on_selector_all(
        "#gallery .tile", "all => all.map(each => each.getAttribute('aria-pressed'))"
    )
    assert [place for place, each in enumerate(pressed) if each == "true"] == [1]


@pytest.mark.parametrize("light", ["night", "sky"])
def test_the_strip_has_the_truth_and_every_row_with_picture_error_and_relit_picture(
    opened: Watched, light: str
) -> None:
    choose(opened, browse_view="2", browse_map="image", browse_light=light)
    pixels(opened, "error-image")
    shown = opened.page.eval_on_selector_all(
        "#strip canvas",
        f"all => all.map(each => {{ each.id = 'one'; const seen = ({PIXELS})('one'); each.id = ''; return seen; }})",
    )
    stored = [arrays(0), arrays(1)]
    expected = [stored[0]["views/2/truth/image"], None, stored[0][f"views/2/truth/relit/{light}"]]
    for each in stored:
        expected += [each["views/2/render/image"], error_codes(each), each[f"views/2/render/relit/{light}"]]
    assert len(shown) == len(expected)
    for found, wanted in zip(shown, expected, strict=True):
        assert (found is None) == (wanted is None)
        assert wanted is None or np.array_equal(np.array(found).reshape(16, 16, 4)[..., :3], wanted)
    choose(opened, browse_map="relit")
    assert opened.page.locator("#strip canvas").count() == 3 * 2, "the relit picture stands there once"


def error_codes(stored: dict[str, np.ndarray]) -> np.ndarray:
    mine, theirs = (stored[f"views/2/{side}/image"] / 255 for side in ("render", "truth"))
    return levels(error("image", mine, theirs).repeat(3, -1))


def test_the_plot_of_views_follows_the_chosen_scene(opened: Watched) -> None:
    choose(opened, browse_scene="other")
    assert opened.page.locator("#views-scene").input_value() == "other"
    assert opened.page.locator("#views-legend li").all_text_contents() == ["Ours"], "it is drawn anew"
    choose(opened, views_scene="my_scene", browse_map="albedo")
    assert opened.page.locator("#views-scene").input_value() == "other", "the choice for the page comes last"


@pytest.mark.parametrize(("size", "last"), [({"width": 1400, "height": 900}, "#strip"), (PHONE, "#table table")])
def test_the_first_screen_has_finding_table_and_on_a_desk_the_strip(
    browser: "playwright.Browser", tmp_path: Path, size: dict[str, int], last: str
) -> None:
    watched = Watched(browser, write_page(made := made_up(), write_run(tmp_path, made))[0], viewport=size)
    tops = [watched.page.evaluate("name => document.querySelector(name).getBoundingClientRect().top", name)
            for name in (".headline", "#table tbody", last)]  # fmt: skip
    assert tops[0] > 0
    assert max(tops) < size["height"] - 100
    watched.close()


def test_the_address_leads_to_the_same_picture_again(browser: "playwright.Browser", opened: Watched) -> None:
    choose(opened, browse_map="relit", browse_light="night", browse_view="2", compare_left="row no-rad")
    address = opened.page.url
    again = browser.new_page()
    again.goto(address)
    assert (again.locator("#browse-said").text_content() or "").startswith(
        "my_scene, test_008; from top to bottom: relit under night; "
    )
    assert again.locator("#compare-left").input_value() == "row no-rad"
    again.goto("about:blank")
    again.goto(address.split("#")[0] + "#browse:map=nothing&view=77&right=row+no-rad")
    said = again.locator("#browse-said").text_content() or ""
    assert said.startswith("my_scene, test_004; from top to bottom: image; "), "what is not there is left out"
    assert again.locator("#compare-right").input_value() == "row no-rad"
    again.close()


def test_pictures_beside_the_page_are_read_from_the_disk_when_they_are_shown(
    browser: "playwright.Browser", tmp_path: Path
) -> None:
    made = summary()
    path, *files = write_page(made, write_run(tmp_path, made), beside=True)
    watched = Watched(browser, path, viewport=DESK)
    watched.page.wait_for_function("document.getElementById('compare-right-image').width === 16")

    def asked() -> set[str]:
        return {url.rsplit("/", 1)[1] for url in watched.asked if "report_files" in url}

    first = asked()
    assert 0 < len(first) < len(files) / 4
    choose(watched, browse_map="depth", browse_view="2")
    watched.page.wait_for_function("!document.getElementById('compare-right-image').hidden")
    watched.page.evaluate("() => new Promise(done => setTimeout(done, 300))")
    shot = watched.page.locator("#compare-right-image").screenshot()
    assert len(asked()) > len(first)
    assert shot != watched.page.locator("#error-image").screenshot()
    watched.close()


def test_a_page_without_its_folder_says_which_file_it_misses(browser: "playwright.Browser", tmp_path: Path) -> None:
    made = summary()
    path, *files = write_page(made, write_run(tmp_path, made), beside=True)
    for each in files:
        each.unlink()
    watched = Watched(browser, path, expected="ERR_FILE_NOT_FOUND", viewport=DESK)
    complaint = watched.page.locator("#sheets-said")
    complaint.wait_for(state="visible")
    assert "report_files/" in (complaint.text_content() or "")
    assert "has to lie beside this page" in (complaint.text_content() or "")
    watched.close()
