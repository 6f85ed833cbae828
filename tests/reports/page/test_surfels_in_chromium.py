"""Surfels in 3-D in headless Chromium: the order from front to back, blending, turning; of results without bits."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from chromium import DESK, Watched, browser, made_up, needed, playwright
from made_up_run import write_run
from radiogs_reports.page.assemble import write_page

pytestmark = needed
__all__ = ["browser"]

SMALL_DESK = {"width": 640, "height": 600}
"""Window in which surfels are drawn: without a graphics card, pixels take time."""


def two_discs() -> dict[str, np.ndarray]:
    """A green disc in the middle and, stored first, a red one before it, seen along X; the rest spans the scene."""
    corners = np.repeat(np.concatenate([np.eye(3), -np.eye(3)]), 10, 0)
    discs = np.array([[0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])
    centre = np.concatenate([corners, discs]).astype(np.float32)
    tangents = np.tile(np.array([[0.0, 5.0, 0.0], [0.0, 0.0, 5.0]], np.float32), (len(centre), 1, 1))
    colour = np.zeros((len(centre), 3), np.float16)
    colour[-2:] = [[0.5, 0, 0], [0, 1, 0]]
    opacity = np.zeros(len(centre), np.float16)
    opacity[-2:] = [0.8, 0.6]
    return {
        "surfels/centre": centre,
        "surfels/tangents": tangents,
        "surfels/opacity": opacity,
        "surfels/radiance": colour,
        "surfels/albedo": colour,
        "surfels/roughness": opacity,
        "surfels/count": np.array([100.0], np.float32),
        "surfels/eye": np.array([0.62, -0.78, 0.48], np.float32),
        "surfels/up": np.array([0.0, 0.0, 1.0], np.float32),
    }


@pytest.fixture
def with_surfels(browser: "playwright.Browser", tmp_path: Path) -> Iterator[Watched]:
    made = made_up()
    out = write_run(tmp_path, made)
    path = out / str(made["runs"][0]["arrays"])
    with np.load(path) as stored:
        np.savez(path, allow_pickle=False, **dict(stored.items()), **two_discs())
    watched = Watched(browser, write_page(made, out)[0], viewport=SMALL_DESK)
    yield watched
    watched.close()


def picture_of(canvas: "playwright.Locator") -> np.ndarray:
    """8-bit sRGB of what is shown, without its border."""
    canvas.page.wait_for_timeout(300)  # two frames of a software renderer
    return np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB"))[20:-20, 20:-20]


def middle_of(canvas: "playwright.Locator") -> list[int]:
    image = picture_of(canvas)
    return image[image.shape[0] // 2, image.shape[1] // 2].tolist()


def test_surfels_are_sorted_and_blended_in_linear_light(with_surfels: Watched) -> None:
    page, canvas = with_surfels.page, with_surfels.page.locator(".turnable").first
    page.locator("#theme").click()  # light
    page.locator("#surfels-head").scroll_into_view_if_needed()
    said = str(page.locator("#surfels-said").text_content())
    assert said.startswith("Ours, my_scene, seed 0: the 62 that cover most of 100 surfels. Results without visibility")
    # 0.8 of red (0.5), 0.6 of green in the rest of 0.2: 0.4 and 0.12 of coverage 0.92, in sRGB, and white paper behind
    assert middle_of(canvas) == pytest.approx([181, 114, 20], abs=2)
    page.locator("#surfels-shown").select_option("normal")  # X is (1, 0.5, 0.5) in display colour
    red, green, blue = middle_of(canvas)
    assert red > 250
    assert green == blue
    page.locator("#surfels-shown").select_option("albedo")
    assert middle_of(canvas) == pytest.approx([181, 114, 20], abs=2)
    for _ in range(31):
        canvas.press("ArrowRight")
    assert middle_of(canvas) == [255, 255, 255], "from behind nothing is seen"
    canvas.press("0")
    assert middle_of(canvas) == pytest.approx([181, 114, 20], abs=2)


def test_two_models_turn_together(with_surfels: Watched) -> None:
    page = with_surfels.page
    left, right = page.locator(".turnable").nth(0), page.locator(".turnable").nth(1)
    assert not right.is_visible()
    page.locator("#surfels-right").select_option(index=1)
    assert right.is_visible()
    before = picture_of(left)
    right.press("ArrowUp")
    right.press("-")
    after = picture_of(left)
    assert (after == picture_of(right)).all()
    assert (after != before).any()
    page.locator("#surfels summary").click()
    assert not left.is_visible()


def test_two_rows_of_a_scene_stand_side_by_side_from_the_beginning(
    browser: "playwright.Browser", tmp_path: Path
) -> None:
    made = made_up()
    out = write_run(tmp_path, made)
    for cell in made["runs"][:2]:
        path = out / str(cell["arrays"])
        with np.load(path) as stored:
            np.savez(path, allow_pickle=False, **dict(stored.items()), **two_discs())
    watched = Watched(browser, write_page(made, out)[0], viewport=DESK)
    chosen = [watched.page.locator(f"#surfels-{side}").input_value() for side in ("left", "right")]
    assert chosen == [made["runs"][0]["key"], made["runs"][1]["key"]]
    assert watched.page.locator(".turnable").nth(1).is_visible()
    watched.close()
