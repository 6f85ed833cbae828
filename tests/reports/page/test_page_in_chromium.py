"""The page in headless Chromium: tables sort, the slider moves, nothing leaves the page, nothing is complained of."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from chromium import DESK, PHONE, Watched, browser, made_up, needed, playwright
from made_up_run import run, summary, written_page

pytestmark = needed
__all__ = ["browser"]

SHEET = {"width": 1032, "height": 703}
"""A4 on its side within its margins, in CSS pixels."""
MORE_CELLS = 12
"""Largest ratio of the times in which pages of 200 and of 20 cells open."""

DARKEST = """(canvas => {
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    return data.some((each, place) => place % 4 === 3 && each > 200 && Math.max(...data.slice(place - 3, place)) < 60);
})"""

LARGEST = 25_000_000
EVIL = "<img src=x onerror=\"document.title='taken'\">"


@pytest.fixture
def opened(browser: "playwright.Browser", tmp_path: Path) -> Iterator[Watched]:
    made = made_up()
    watched = Watched(browser, written_page(made, tmp_path), viewport=DESK)
    yield watched
    watched.close()


def test_tables_sort_by_click_best_first_and_missing_values_stay_last(opened: Watched) -> None:
    head = opened.page.locator('table[data-name="means"] thead button')
    head.nth(1).click()
    assert opened.column("means", 1) == ["31.23", "30.00", "n/a"]
    head.nth(1).click()
    assert opened.column("means", 1) == ["30.00", "31.23", "n/a"]
    head.nth(2).click()  # an angle: the smallest is the best; 11.00 sorts as a number
    assert opened.column("means", 2) == ["7.00", "7.50", "11.00"]
    sorted_by = opened.page.locator('table[data-name="means"] th[aria-sort]')
    assert [each.get_attribute("aria-sort") for each in sorted_by.all()] == ["ascending"]


def test_tables_sort_by_keyboard_and_by_published_values(opened: Watched) -> None:
    opened.page.locator('table[data-name="means"] thead button').nth(1).focus()
    opened.page.keyboard.press("Enter")
    assert opened.column("means", 1) == ["31.23", "30.00", "n/a"]
    opened.page.locator('select[data-table="means"]').select_option("published")
    assert opened.column("means", 0) == ["third", "Ours", "lambda_rad = 0"]  # 40.00, 37.86, 35.82
    opened.page.keyboard.press("Shift+Tab")
    opened.page.locator('table[data-name="cells"] thead button').nth(2).press("Space")
    assert opened.column("cells", 2) == ["0", "0", "1"]


def test_the_slider_moves_the_edge_by_keyboard_and_by_pointer(opened: Watched) -> None:
    slider, clip = opened.page.locator("#compare-slider"), opened.page.locator("#compare-clip")
    assert clip.evaluate("each => each.style.clipPath") == "inset(0px 50% 0px 0px)"
    slider.press("ArrowLeft")
    assert clip.evaluate("each => each.style.clipPath") == "inset(0px 50.5% 0px 0px)"
    stage = opened.page.locator("#compare-stage")
    stage.scroll_into_view_if_needed()
    frame = stage.bounding_box()
    assert frame is not None
    opened.page.mouse.move(frame["x"] + frame["width"] / 2, frame["y"] + 20)
    opened.page.mouse.down()
    opened.page.mouse.move(frame["x"] + frame["width"] / 4, frame["y"] + 20)
    opened.page.mouse.up()
    assert float(slider.input_value()) == pytest.approx(25, abs=0.6)


def test_zoom_is_one_for_all_pictures_and_keeps_them_in_their_frame(opened: Watched) -> None:
    opened.page.locator("#error-stage").press("+")
    transforms = opened.page.eval_on_selector_all(".layer", "all => all.map(each => each.style.transform)")
    assert transforms == ["translate(-25%, -25%) scale(1.5)"] * 3
    for _ in range(9):
        opened.page.locator("#compare-stage").press("ArrowRight")
    transforms = opened.page.eval_on_selector_all(".layer", "all => all.map(each => each.style.transform)")
    assert transforms == ["translate(-50%, -25%) scale(1.5)"] * 3
    opened.page.locator("#zoom-none").click()
    assert opened.page.locator("#zoom-said").text_content() == "1.0 times"


def test_points_of_the_scatter_are_described_on_hover_and_by_arrow_keys(opened: Watched) -> None:
    box = opened.page.locator("#scatter")
    box.press("ArrowRight")
    first = opened.page.locator("#scatter-said").text_content() or ""
    assert first == "lambda_rad = 0, mean: NVS PSNR 30.00 ± 0.50 dB for 21 s"
    box.press("ArrowLeft")
    assert opened.page.locator("#scatter-said").text_content() != first
    ring = opened.page.locator("#scatter .ring").bounding_box()
    box.press("Escape")
    assert ring is not None
    tip = opened.page.locator("#scatter .tip")
    assert not tip.is_visible()
    opened.page.mouse.move(ring["x"] + 10, ring["y"] + 10)
    assert "NVS PSNR" in (tip.text_content() or "")
    assert tip.is_visible()


def test_rows_beyond_the_eight_colours_are_rings(browser: "playwright.Browser", tmp_path: Path) -> None:
    made = summary()
    for place in range(7):
        made["rows"].append({"key": f"r{place}", "latex": "", "text": f"row {place}", "seconds": 1.0})
        made["cells"][f"r{place}"] = made["cells"]["ours"]
    watched = Watched(browser, written_page(made, tmp_path), viewport=DESK)
    looks = watched.page.eval_on_selector_all(
        "#scatter-legend .dot",
        "dots => dots.map(dot => [getComputedStyle(dot).borderColor, getComputedStyle(dot).backgroundColor].join())",
    )
    assert len(looks) == len(set(looks)) == 9
    watched.close()


def test_a_run_that_trained_nothing_and_keeps_no_pictures_has_no_empty_parts(
    browser: "playwright.Browser", tmp_path: Path
) -> None:
    made = summary()
    made["rows"], made["reference"] = made["rows"][:1], None
    made["runs"], made["seeds"] = made["runs"][:1], [0]
    made["runs"][0] |= {"seconds": {}, "work": {}, "view": None, "light": None, "by_view": {}}
    watched = Watched(browser, written_page(made, tmp_path), viewport=DESK)
    there = watched.page.eval_on_selector_all("main > section", "each => each.map(part => part.id)")
    assert there == ["overview", "table", "cells", "paper", "conditions", "protocol"]
    linked = watched.page.eval_on_selector_all("nav a", "each => each.map(link => link.hash.slice(1))")
    assert linked == there
    watched.page.locator("button.open").click()
    assert watched.page.get_by_text("Show its images").count() == 0
    watched.close()


def test_a_cell_shows_its_provenance_and_its_images(opened: Watched) -> None:
    opened.page.locator('table[data-name="cells"] button.open').nth(1).press("Enter")
    dialog = opened.page.locator("dialog")
    text = dialog.inner_text()
    for part in ("def", "fedcba", "0123456789", "2026-01-02", "radiance"):
        assert part in text
    links = dialog.locator("a").evaluate_all("all => all.map(each => each.getAttribute('href'))")
    assert links == ["cells/def.json", "cells/def.npz"]
    dialog.get_by_text("Show its images").click()
    assert not dialog.is_visible()
    assert opened.page.locator("#compare-right").input_value() == "row no-rad"


def test_everything_is_reached_by_the_tab_key_in_reading_order(opened: Watched) -> None:
    order = []
    for _ in range(90):
        opened.page.keyboard.press("Tab")
        place = opened.page.evaluate("""() => {
            const each = document.activeElement;
            return each === document.body ? null
                : [each.closest('section')?.getBoundingClientRect().top + scrollY || 0,
                   each.id || each.className || each.textContent];
        }""")
        if place is None:
            break
        order.append(place)
    names = [name for _, name in order]
    for wanted in ("theme", "sort-by", "sort", "scatter", "compare-stage", "compare-slider", "zoom-in", "open"):
        assert wanted in names
    tops = [top for top, _ in order]  # of the part of the page that each stands in
    assert tops == sorted(tops)
    assert len(set(tops)) == 10


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_colours_follow_the_system_until_the_switch_says_otherwise(
    browser: "playwright.Browser", tmp_path: Path, scheme: str
) -> None:
    made = summary()
    watched = Watched(browser, written_page(made, tmp_path), color_scheme=scheme)

    def lightness() -> int:
        colour = watched.page.evaluate("getComputedStyle(document.body).backgroundColor")
        return int(colour.removeprefix("rgb(").split(",")[0])

    assert (lightness() > 128) == (scheme == "light")
    watched.page.locator("#theme").click()
    assert lightness() > 128
    watched.page.locator("#theme").click()
    assert lightness() < 128
    watched.close()


def test_on_paper_all_is_unfolded_and_dark_on_light_and_afterwards_as_before(
    browser: "playwright.Browser", tmp_path: Path
) -> None:
    made = made_up()
    made["doubts"] = [{"column": "", "rows": ["ours"], "text": "geometry: of its own"}]
    watched = Watched(browser, written_page(made, tmp_path), color_scheme="dark", viewport=SHEET)
    page = watched.page

    def state() -> list[object]:
        return page.evaluate(
            "[[...document.querySelectorAll('details')].map(each => each.open),"
            " getComputedStyle(document.body).backgroundColor, document.documentElement.dataset.theme ?? null]"
        )

    remark = page.get_by_text("geometry: of its own")
    before = state()
    assert not remark.is_visible()
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    unfolded, background, _ = state()
    assert len(unfolded) > 1
    assert all(unfolded)
    assert remark.is_visible()
    assert background == "rgb(255, 255, 255)"
    inks = "[...document.querySelectorAll('#scatter canvas, #views-plot canvas')].map(dark)".replace("dark", DARKEST)
    assert page.evaluate(inks) == [True, True], "axes and texts of the plots are dark on paper"
    cut = (
        "[...document.querySelectorAll('.scroll')].filter(each => each.scrollWidth > document.body.clientWidth).length"
    )
    assert page.evaluate(cut) == 0, "no table is wider than the sheet"
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    page.emulate_media(media="screen")
    assert state() == before
    watched.close()


@pytest.mark.parametrize("size", [DESK, PHONE])
def test_the_page_is_never_wider_than_the_window(
    browser: "playwright.Browser", tmp_path: Path, size: dict[str, int]
) -> None:
    made = made_up()
    made["scenes"] = ["a_scene_with_a_very_long_name_" * 3]
    watched = Watched(browser, written_page(made, tmp_path), viewport=size)
    assert watched.page.evaluate("document.documentElement.scrollWidth") <= size["width"]
    watched.close()


def test_names_that_are_markup_stay_text(browser: "playwright.Browser", tmp_path: Path) -> None:
    made = summary()
    made["title"] = EVIL
    made["rows"][0]["text"] = made["columns"][0]["label"] = EVIL
    for each in made["runs"]:
        each["scene"] = each["state"] = EVIL
    made["conventions"] = {EVIL: EVIL}
    watched = Watched(browser, written_page(made, tmp_path))
    watched.page.locator("button.open").first.click()
    watched.page.locator("#scatter").evaluate("each => each.focus()")
    assert watched.page.title() == f"{EVIL} · radiogs-bench"
    assert watched.page.locator("img[onerror], img[src='x']").count() == 0
    watched.close()


@pytest.mark.slow
def test_200_cells_open_at_once_in_a_file_that_can_be_sent(browser: "playwright.Browser", tmp_path: Path) -> None:
    def opened_in(scenes: int, seeds: int) -> float:
        """Milliseconds until a page with so many scenes and seeds, of two rows, is there: the shorter time of two."""
        made = summary()
        made["runs"] = [
            run(row["key"], f"scene_{scene}", seed, f"{row['key']}{scene}x{seed}", {"nvs/psnr": 30 + seed / 10})
            for scene in range(scenes)
            for seed in range(seeds)
            for row in made["rows"]
        ]
        path = written_page(made, tmp_path, size=64)
        assert path.stat().st_size < LARGEST
        times = []
        for _ in range(2):
            watched = Watched(browser, path, viewport=DESK)
            assert watched.page.locator('table[data-name="cells"] tbody tr').count() == 2 * scenes * seeds
            watched.page.locator("#gallery canvas").first.wait_for()  # pictures of 200 cells are reduced
            times.append(watched.page.evaluate("performance.getEntriesByType('navigation')[0].loadEventEnd"))
            watched.close()
        return float(min(times))

    assert opened_in(10, 10) < MORE_CELLS * opened_in(5, 2)


@pytest.fixture
def of_two_seeds(browser: "playwright.Browser", tmp_path: Path) -> Iterator[Watched]:
    """Two rows, two scenes and two seeds; ``ours`` has 31.0, 33.0 and 29.0 dB."""
    made = made_up()
    made["scenes"] = ["my_scene", "other"]
    values = {"normal/mae": 7.4, "nvs/lpips": None}
    made["runs"][2] = run("ours", "my_scene", 1, "123", {"nvs/psnr": 33.0, **values})
    made["runs"].append(run("ours", "other", 0, "456", {"nvs/psnr": 29.0, **values}))
    watched = Watched(browser, written_page(made, tmp_path), viewport=DESK)
    yield watched
    watched.close()


def tick(watched: Watched, name: str, value: str) -> None:
    watched.page.locator(f'#selection input[name="{name}"][value="{value}"]').click()


def test_the_table_of_means_follows_the_ticked_cells(of_two_seeds: Watched) -> None:
    page = of_two_seeds.page
    page.locator("#selection summary").click()
    assert of_two_seeds.column("means", 1)[0] == "31.23"
    tick(of_two_seeds, "scene", "other")
    assert page.locator("#selection-said").text_content() == "3 of 4 cells are shown."
    assert of_two_seeds.column("means", 1)[:2] == ["32.00", "30.00"], "31 and 33 of ours, 30 of the other row"
    tick(of_two_seeds, "seed", "1")
    assert of_two_seeds.column("means", 1)[:2] == ["31.00", "30.00"]
    assert of_two_seeds.column("means", 4)[:2] == ["31.0", "21.0"], "seconds of training, without the evaluation"
    assert not page.locator("#means-partial").is_hidden()
    assert page.locator('table[data-name="means"] .difference').count() == 0
    hidden = 'table[data-name="cells"] tbody tr[hidden]'
    assert page.locator(hidden).count() == 2
    page.locator('table[data-name="means"] thead button').nth(1).click()
    assert of_two_seeds.column("means", 1)[:2] == ["31.00", "30.00"], "sorted by what is shown"
    tick(of_two_seeds, "seed", "1")
    tick(of_two_seeds, "scene", "other")
    assert page.locator("#means-partial").is_hidden()
    assert page.locator(hidden).count() == 0
    assert of_two_seeds.column("means", 1)[:2] == ["31.23", "30.00"]
    assert page.locator('table[data-name="means"] .difference').count() > 0


def test_rows_that_are_not_ticked_leave_tables_plots_and_images(of_two_seeds: Watched) -> None:
    page = of_two_seeds.page
    page.locator("#selection summary").click()
    tick(of_two_seeds, "row", "no-rad")
    assert page.locator('table[data-name="means"] tbody tr:visible').count() == 2
    assert of_two_seeds.column("means", 1)[0] == "30.50", "the mean over scenes of 31 and 33, and of 29"
    assert "lambda_rad = 0" not in page.locator("#compare-right").inner_text()
    assert "lambda_rad = 0" not in page.locator("#views-legend").inner_text()
    assert "lambda_rad = 0" not in page.locator("#scatter-legend").inner_text()
    page.locator('#selection button[value="row"]').click()
    assert "lambda_rad = 0" in page.locator("#views-legend").inner_text()
    page.locator('#selection button[value="row"]').click()
    assert page.locator("#selection-said").text_content() == "0 of 4 cells are shown."
    assert page.locator("#views-said").text_content() == "No ticked cell of this scene has it by view."
    assert not page.locator("#compare-none").is_hidden()


def test_a_metric_is_shown_view_by_view_with_the_best_row_first(of_two_seeds: Watched) -> None:
    page, said = of_two_seeds.page, of_two_seeds.page.locator("#views-said")
    plot = page.locator("#views-plot")
    plot.press("ArrowRight")
    assert said.text_content() == "test_000: Ours 32.00, lambda_rad = 0 30.00"
    plot.press("ArrowLeft")  # round to the last view: 31 - 0.5 and 33 - 1.5 of ours, 30 - 0.5
    assert said.text_content() == "test_008: Ours 31.00, lambda_rad = 0 29.50"
    page.locator("#views-order").select_option("value")
    plot.press("ArrowRight")
    assert str(said.text_content()).startswith("test_008")
    page.locator("#views-scene").select_option("other")
    page.locator("#views-order").select_option("stored")
    plot.press("ArrowRight")
    assert said.text_content() == "test_000: Ours 29.00"
    frame = plot.locator(".u-over").bounding_box()
    assert frame is not None
    page.mouse.move(frame["x"] + frame["width"] / 2, frame["y"] + frame["height"] / 2)
    assert said.text_content() == "test_004: Ours 29.50"
