"""Arrays that are kept with a result for the reports: maps of a view, codes of more views, lights and surfels."""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Trained
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.light import EnvironmentMap, texel_directions
from radiogs_core.scene.scene import Scene, View
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.interreflection import light_paths
from radiogs_core.transport.prefiltered_light import pooled
from radiogs_core.transport.tracer import SurfelTracer

from ..initial_viewpoint import InitialViewpoint
from .score_maps import Maps, truth

SHOWN = ("image", "albedo", "normal", "roughness", "indirect")
"""Maps of the shown view that are kept."""

ARRIVING = ("incident", "incident_direct")
"""Maps of incident light, indirect and direct, that are also kept if a method offers them."""

LIGHTS_SHOWN = 4
"""Number of lights for which relit maps of the shown view are kept; the same lights are kept with the surfels."""

MAPS = ("image", "albedo", "normal", "roughness", "depth", "indirect")
"""Maps whose codes are kept of a view, beside its relit images."""

KEPT_BYTES = 128 * 2**20
"""Bytes of a cell's codes, before compression, predictions and truth together, if no number of views is set."""

CHANNELS = 14
"""Channels of all ``MAPS`` together."""

MARGIN = 0.1
"""Share of the true range by which the range of depths is extended on both sides."""

LARGEST_HEIGHT = 64
"""Most rows of a kept light: as many as the finest learnt map has (preset ``paper``); measured maps have up to 1024."""

MOST_SURFELS = 50_000
"""Most surfels that are kept: the ones with the largest area times opacity. About 2 MB."""

LIGHT_HEIGHT = 32
"""Rows of the lights that are kept with surfels: a texel is about as wide as 512 directions are apart."""

RECOVERED = "recovered"
"""Name of a model's own light among the kept lights."""

Image = Float[Tensor, "height width channels"]
Grey = Float[Tensor, "height width 1"]


class ReportArrays:
    """Maps of the middle test view and codes of chosen views, collected while they are scored.

    ``arrays`` has ``render/<map>`` and ``truth/<map>`` of that view, on black, float32 [height, width, channels]:
    image, albedo (linear, aligned), normal, roughness, indirect (linear), relit (under its first light) and
    ``relit/<light>`` and ``relit_indirect/<light>`` (under the first few). Maps without ground truth have no
    ``truth/``. ``render/incident``, the incident indirect light, is there if a method renders it;
    ``render/environment`` and ``truth/environment`` (see ``light_maps``) if both lights are known.

    Codes are uint8 [height, width, channels] by ``views/<number>/<side>/<map>``: ``number`` is the view's position
    among the test views and views elsewhere, ``side`` is ``render`` or ``truth``. Images are in display sRGB, albedo
    and indirect light are encoded in sRGB, normals are (n + 1) / 2 with 0 0 0 where there is no surface, depth is 255
    in front to 1 at the back and 0 where nothing is seen, over one range for everyone who renders the view.
    """

    def __init__(self, scene: Scene, lit: Mapping[str, Sequence[View]], kept_views: int | None) -> None:
        """``lit``: the relit views of each light. ``kept_views``: how many views have codes (``views_to_keep``)."""
        self.scene, self.lights, self.extent = scene, list(lit), scene.extent
        self.shown = scene.test[len(scene.test) // 2]
        self.first_light = next((light for light, views in lit.items() if self.shown in views), None)
        self.kept = views_to_keep(scene, kept_views)
        self.codes: dict[str, np.ndarray] = {}
        self.maps: dict[str, Tensor] = {
            f"truth/{name}": truth(self.shown, name) for name in SHOWN if self.shown.has(name)
        }

    @property
    def shown_light(self) -> str | None:
        """The light of the relit map; None without a relit map."""
        return self.first_light if "render/relit" in self.maps else None

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """Everything that was collected, by name."""
        return {name: image.cpu().numpy().astype(np.float32) for name, image in self.maps.items()} | self.codes

    def add(self, view: View, maps: Maps) -> None:
        """Keep a test view under its own light; its albedo is added once it is aligned."""
        self._encode(view, {name: image for name, image in maps.items() if name != "albedo"})
        if view is self.shown:
            self.maps |= {f"render/{name}": maps[name] for name in (*SHOWN, *ARRIVING) if name in maps}

    def add_albedo(self, rendered: Mapping[str, Maps], scale: Float[Tensor, "3"] | None) -> None:
        """Keep the albedo of the test views, times the factor that aligns it with the true one."""
        factor = torch.ones(3) if scale is None else scale
        for view in self.scene.test:
            if "albedo" in rendered[view.name]:
                aligned = rendered[view.name]["albedo"] * factor
                self._encode(view, {"albedo": aligned})
                self.maps |= {"render/albedo": aligned} if view is self.shown else {}

    def add_relit(self, view: View, light: str, maps: Maps, target: Image, *, indirect: bool = False) -> None:
        """Keep a view under another light, beside the true one; ``indirect``: its indirect light, too."""
        image = maps["image"]
        if view.name in self.kept:
            self._keep(view, "render", f"relit/{light}", image)
            self._keep(view, "truth", f"relit/{light}", target)
        if view is self.shown and light == self.first_light:
            self.maps |= {"render/relit": image, "truth/relit": target}
        if view is self.shown and light in self.lights[:LIGHTS_SHOWN]:
            self.maps |= {f"render/relit/{light}": image, f"truth/relit/{light}": target}
            if indirect:
                self.maps[f"render/relit_indirect/{light}"] = maps["indirect"]
                self.maps[f"truth/relit_indirect/{light}"] = truth(view, f"relit/{light}/indirect")

    def add_light(self, found: EnvironmentMap) -> None:
        """Keep the recovered light, and the true one if it is known."""
        if self.scene.training_light is not None:
            self.maps |= light_maps(found, self.scene.training_light)

    def _encode(self, view: View, maps: Maps) -> None:
        """Keep the codes of maps of a view and of their truth, if the view is among the chosen."""
        for name in MAPS if view.name in self.kept else ():
            if name in maps:
                self._keep(view, "render", name, self._shown(view, name, maps[name], maps.get("alpha")))
                if view.has(name):
                    self._keep(view, "truth", name, self._shown(view, name, truth(view, name), None))

    def _keep(self, view: View, side: str, name: str, shown: Image) -> None:
        finite = torch.where(shown.isfinite(), shown, 0.0)  # maps may have no value where nothing is
        number = [each.name for each in (*self.scene.test, *self.scene.relight)].index(view.name)
        self.codes[f"views/{number}/{side}/{name}"] = (255 * finite.clamp(0, 1)).round().to(torch.uint8).cpu().numpy()

    def _shown(self, view: View, name: str, image: Image, alpha: Grey | None) -> Image:
        if name in ("albedo", "indirect"):
            return srgb_encode(image)
        if name == "normal":
            return torch.where((image == 0).all(-1, keepdim=True), 0.0, image / 2 + 0.5)
        if name == "depth":
            near, far = depth_range(view, self.extent)
            seen = (image > 0) if alpha is None else (image > 0) & (alpha > 0.5)
            return torch.where(seen, (1 - (image - near) / (far - near)).clamp(1 / 255, 1), 0.0)
        return image


def light_maps(found: EnvironmentMap, true: EnvironmentMap) -> dict[str, Float[Tensor, "height width 3"]]:
    """``render/environment`` and ``truth/environment``, linear, of one size: truth averaged, ours interpolated."""
    height = min(true.radiance.shape[0], LARGEST_HEIGHT)
    directions = texel_directions(height, 2 * height, dtype=found.radiance.dtype)
    return {"render/environment": found.lookup(directions), "truth/environment": pooled(true.radiance.cpu(), height)}


def depth_range(view: View, extent: float) -> tuple[float, float]:
    """Depths shown in white and in black: the true range with a margin; without truth, 0 to twice the extent."""
    if view.has("depth"):
        depth = truth(view, "depth")
        seen = depth[depth > 0]
        if len(seen) and float(seen.max()) > float(seen.min()):
            low, high = float(seen.min()), float(seen.max())
            return low - MARGIN * (high - low), high + MARGIN * (high - low)
    return 0.0, 2 * extent


def views_to_keep(scene: Scene, count: int | None) -> frozenset[str]:
    """Names of so many views, evenly spread around the middle one; None: as many as fit ``KEPT_BYTES``, or one."""
    views = [*scene.test, *scene.relight]
    middle = len(scene.test) // 2
    if count is None:
        camera, channels = views[middle].camera, 2 * (CHANNELS + 3 * len(scene.lights))
        count = max(1, KEPT_BYTES // (channels * camera.height * camera.width))
    count = min(count, len(views))
    return frozenset(views[(middle + index * len(views) // count) % len(views)].name for index in range(count))


def surfel_arrays(
    model: Trained, seen_from: InitialViewpoint, lights: Mapping[str, EnvironmentMap]
) -> dict[str, np.ndarray]:
    """The arrays of a model's ``surfels``, with its own light and the first of ``lights``; empty without surfels."""
    surfels = getattr(model, "surfels", None)
    if not isinstance(surfels, Surfels) or not len(surfels):
        return {}
    own = {} if model.light is None else {RECOVERED: model.light}
    return arrays_of(surfels, seen_from, own | dict(list(lights.items())[:LIGHTS_SHOWN]))


@torch.no_grad()
def arrays_of(
    surfels: Surfels, seen_from: InitialViewpoint, lights: Mapping[str, EnvironmentMap]
) -> dict[str, np.ndarray]:
    """Arrays of at least one and at most ``MOST_SURFELS`` surfels by name, for the report's 3-D view.

    ``surfels/centre`` [N, 3] and ``surfels/tangents`` [N, 2, 3], scaled by their standard deviations, float32, world
    units; ``surfels/opacity`` [N], ``surfels/radiance`` (mean over directions) and ``surfels/albedo`` [N, 3], linear,
    and ``surfels/roughness`` [N], float16; ``surfels/count`` [1], the model's number of surfels; ``surfels/eye``,
    ``surfels/up``, ``surfels/middle`` [3] and ``surfels/arc`` [2], the ``InitialViewpoint`` (the last two if it has
    them).

    For relighting (``light_paths``): ``surfels/seen`` [N, 64], uint8, one bit per direction, lowest bit first;
    ``surfels/met`` [N, 32], int32, indices of kept surfels, -1 for none; ``surfels/light/<name>`` [32, 64, 3], linear
    radiance of lights in the model's world.
    """
    kept = (surfels.opacity * surfels.scale.prod(-1)).argsort(descending=True, stable=True)[:MOST_SURFELS]
    any_direction = torch.tensor([0.0, 0.0, 1.0], device=surfels.centre.device).expand_as(surfels.centre)
    tangents = surfels.frame[..., :2].mT * surfels.scale[..., None]
    shown = {
        "opacity": surfels.opacity,
        "radiance": surfel_radiance(surfels.sh[:, :1], any_direction),
        "albedo": surfels.albedo,
        "roughness": surfels.roughness,
    }
    largest = torch.finfo(torch.float16).max
    arrays = {name: values[kept].clamp(max=largest).half().cpu().numpy() for name, values in shown.items()}
    arrays["centre"], arrays["tangents"] = surfels.centre[kept].cpu().numpy(), tangents[kept].cpu().numpy()
    arrays["count"] = np.array([len(surfels)], dtype=np.float32)
    arrays |= {name: np.array(value, np.float32) for name, value in seen_from.plain().items()}
    seen, met = light_paths(SurfelTracer(surfels), kept)
    place = torch.full((len(surfels) + 1,), -1, device=kept.device)  # the last entry is that of -1
    place[kept] = torch.arange(len(kept), device=kept.device)
    arrays["seen"] = np.packbits(seen.cpu().numpy(), axis=1, bitorder="little")
    arrays["met"] = place[met].int().cpu().numpy()
    directions = texel_directions(LIGHT_HEIGHT, 2 * LIGHT_HEIGHT).float()
    for name, light in lights.items():
        radiance = light.radiance.cpu().float()
        larger = len(radiance) > LIGHT_HEIGHT
        reduced = pooled(radiance, LIGHT_HEIGHT) if larger else EnvironmentMap(radiance).lookup(directions)
        arrays[f"light/{name}"] = reduced.numpy()
    return {f"surfels/{name}": values for name, values in arrays.items()}
