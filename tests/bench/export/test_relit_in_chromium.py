"""Surfels relit in headless Chromium, against the renderer's pictures of the same surfels under the same light."""

import io
import math
import struct
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from PIL import Image

from chromium import Watched, browser, needed, playwright
from radiogs_bench.export.turntable import cameras_around
from radiogs_bench.initial_viewpoint import InitialViewpoint
from radiogs_bench.scoring.report_arrays import RECOVERED, arrays_of
from radiogs_core.kernels.image.display import displayed
from radiogs_core.scene.light import EnvironmentMap, texel_directions, texel_solid_angles
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.interreflection import bounced_incident
from radiogs_core.transport.maps import shaded_maps
from radiogs_core.transport.sampling import relighting_directions
from radiogs_core.transport.tracer import SurfelTracer
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Box, Sphere
from radiogs_reports.page.surfels import write_viewer
from scenes import surfels_over

pytestmark = needed
__all__ = ["browser"]

SIDE = 96
SEEN_FROM = InitialViewpoint(torch.tensor([3.0, -2.5, 2.2]), torch.tensor([0.0, 0.0, 1.0]), torch.tensor([0.0, 0, 0.5]))
SUN, HEIGHT, STEP = 0.7, 0.8, 0.1
"""Initial position of the sun (radians from the eye and above the horizon), and its step per arrow key."""

SKY = EnvironmentMap(
    (0.6 + texel_directions(32, 64).float() @ torch.tensor([0.2, 0.0, 0.35]))[..., None] * torch.tensor([0.8, 0.9, 1.1])
)
"""Brighter from above, and from +X."""


def ball_on_a_table() -> Surfels:
    """A rough ball over a table, beside a red wall."""
    solids = [
        Sphere((0.0, 0.0, 0.6), 0.5, Material((0.6, 0.6, 0.5), 0.6)),
        Box((-1.0, -1.0, -0.1), (1.0, 1.0, 0.0), Material((0.7, 0.7, 0.7), 0.8)),
        Box((-1.1, -1.0, 0.01), (-1.0, 1.0, 1.2), Material((0.7, 0.1, 0.1), 0.8)),
    ]
    return surfels_over(solids, 0.15)


SURFELS = ball_on_a_table()


def rendered(light: EnvironmentMap, shown: str = "relit") -> np.ndarray:
    """The picture of relighting by traced bounces from the first viewpoint, on white, display sRGB."""
    [camera] = cameras_around(SURFELS, 1, SIDE, SEEN_FROM)
    drawn = relighting_directions(SURFELS.frame[..., 2], LightSampler(light), 64, 64, torch.Generator().manual_seed(0))
    with torch.no_grad():
        incident = bounced_incident(SurfelTracer(SURFELS), SURFELS.albedo, light.radiance, drawn, 4)
        maps = shaded_maps(camera, SURFELS, SURFELS.albedo, incident, light.radiance)
        linear = maps["direct"] + maps["indirect"] if shown == "relit" else maps[shown]
        return (displayed(linear, maps["alpha"][..., 0]).clamp(0, 1) + 1 - maps["alpha"]).numpy()


def with_sun(turn: float, strength: float) -> EnvironmentMap:
    """The sky at an eighth, and a sun of two degrees in it that a surface facing it receives ``strength`` from."""
    back = SEEN_FROM.eye - torch.tensor([0.0, 0.0, 0.5])
    forth = torch.nn.functional.normalize(back * torch.tensor([1.0, 1.0, 0.0]), dim=0)
    side = torch.linalg.cross(SEEN_FROM.up, forth)
    level = math.cos(turn) * forth + math.sin(turn) * side
    towards = math.cos(HEIGHT) * level + math.sin(HEIGHT) * SEEN_FROM.up
    disc = (texel_directions(256, 512).float() @ towards > math.cos(math.radians(1)))[..., None].float()
    sky = SKY.radiance.repeat_interleave(8, 0).repeat_interleave(8, 1) / 8
    return EnvironmentMap(sky + strength * disc / (disc[..., 0] * texel_solid_angles(256, 512).float()).sum())


def similarity(one: np.ndarray, other: np.ndarray) -> float:
    """PSNR in dB."""
    return float(-10 * np.log10(((one - other) ** 2).mean()))


class Viewer(Watched):
    """The page of the surfels, its canvas in the upper left corner."""

    def set(self, name: str, value: float) -> None:
        self.page.eval_on_selector(
            f"#surfels-{name}",
            "(each, value) => { each.value = value; each.dispatchEvent(new Event('input')); }",
            value,
        )

    def picture(self) -> np.ndarray:
        """The canvas once it has drawn the latest choices, display units."""
        self.page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        self.page.wait_for_timeout(200)
        clip = {"x": 0, "y": 0, "width": SIDE, "height": SIDE}
        return np.asarray(Image.open(io.BytesIO(self.page.screenshot(clip=clip))).convert("RGB")) / 255

    def dropped(self, path: Path) -> str:
        """Drop a file onto the page; returns the page's message."""
        said, before = self.page.locator("#surfels-said"), self.page.locator("#surfels-said").text_content()
        self.page.locator("#surfels-file").set_input_files(path)
        self.page.wait_for_function(
            "before => document.getElementById('surfels-said').textContent !== before", arg=before
        )
        return str(said.text_content())


@pytest.fixture
def viewer(browser: "playwright.Browser", tmp_path: Path) -> Iterator[Viewer]:
    arrays = arrays_of(SURFELS, SEEN_FROM, {RECOVERED: SKY})
    path = write_viewer(arrays, "ball", tmp_path / "surfels.html")
    opened = Viewer(browser, path, viewport={"width": 400, "height": 600}, color_scheme="light")
    opened.page.eval_on_selector(
        ".turnable",
        f"""each => Object.assign(each.style, {{position: "fixed", left: 0, top: 0, zIndex: 9, border: "none",
        borderRadius: 0, width: "{SIDE}px", height: "{SIDE}px"}})""",
    )
    yield opened
    opened.close()


def test_surfels_under_their_own_light_and_a_sun_are_as_the_renderer_shows_them(viewer: Viewer) -> None:
    """Direct light with shadows, two colours of bounced light and lobes; the sun is turned by keys."""
    for shown in ("direct", "indirect", "albedo", "relit"):
        viewer.page.locator("#surfels-shown").select_option(shown)
        assert similarity(viewer.picture(), rendered(SKY, shown)) > 38, shown
    viewer.page.locator("#surfels-drag").select_option("sun")
    viewer.set("strength", -3)
    viewer.set("sun", 3)
    turned = 0
    for keys in (0, 5, -24):
        for _ in range(abs(keys)):
            viewer.page.locator(".turnable").first.press("ArrowRight" if keys > 0 else "ArrowLeft")
        turned += keys
        assert similarity(viewer.picture(), rendered(with_sun(SUN + STEP * turned, 3))) > 32, turned


def test_a_map_from_a_file_stands_upright_and_one_that_is_no_map_is_refused_before_it_is_decoded(
    viewer: Viewer, tmp_path: Path
) -> None:
    file = tmp_path / "sky.hdr"
    turned = SKY.radiance.roll(16, 1).numpy()  # the map's columns, by a quarter
    cv2.imwrite(str(file), np.ascontiguousarray(turned.repeat(4, 0).repeat(4, 1)[..., ::-1]))
    viewer.page.locator("#surfels-drag").select_option("light")
    assert viewer.dropped(file).endswith("under the light map: sky.hdr.")
    assert viewer.page.locator("#surfels-light").input_value() == "map:sky.hdr"
    viewer.set("turn", 90)
    assert similarity(viewer.picture(), rendered(SKY)) > 38
    levels = (255 * np.random.default_rng(0).random((32, 64, 3))).astype(np.uint8)
    Image.fromarray(levels).save(tmp_path / "noise.png")
    assert viewer.dropped(tmp_path / "noise.png").endswith("map: noise.png.")
    Image.fromarray(levels[:, :32]).save(tmp_path / "square.png")
    assert "is 32 x 32: a map of the whole sphere is twice as wide as high" in viewer.dropped(tmp_path / "square.png")
    large = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 80_000, 40_000)
    (tmp_path / "large.png").write_bytes(large)
    assert "at most 8,388,608 texels" in viewer.dropped(tmp_path / "large.png")
    file.write_bytes(file.read_bytes()[:300])
    assert "ends before its last row" in viewer.dropped(file)
