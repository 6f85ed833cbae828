"""Recorded lights against images: the true surfaces, shaded by a map of light, look like the views under that light.

Light is gathered from 16 x 32 texels. Shadows are cast by a coarse grid of the surface in the test views' depth;
without depth there are no shadows. Inter-reflection is left out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from radiogs_core.scene.light import EnvironmentMap, texel_directions, texel_solid_angles

from ..findings import Finding, warning
from .cameras import Array, best
from .colours import DISPLAY, LINEAR, decoded
from .evidence import Evidence, Truth, some_pixels
from .surface import Points

ROWS, COLUMNS = 16, 32
"""Texels of the reduced maps of light."""

POINTS_OF_A_VIEW, MOST_POINTS = 90, 480
"""Points that are shaded: of a view, and of all views."""

CELLS, STRIDE, LEAVING = 40, 1.25, 2.0
"""Cells of the longer side of the occluding grid; length of a ray's step, and its start above the surface, in cells."""

NORMAL_INCIDENCE, SMOOTHEST = 0.04, 0.2
"""Reflectance of the specular lobe at normal incidence, and roughness below which it is narrower than a texel."""


@dataclass(frozen=True)
class Lit(Points):
    """Points and the light that they receive from each texel."""

    normal: Array
    """Unit normals [points, 3]."""
    towards: Array
    """Unit directions to the camera [points, 3]."""
    open: Array
    """Solid angle of each texel if nothing hides it, else zero [points, texels]."""

    def diffuse(self) -> Array:
        """Share of each texel's radiance in the irradiance by pi."""
        return np.asarray((self.normal @ DIRECTIONS.T).clip(0) * self.open / np.pi)

    def specular(self, roughness: Array) -> Array:
        """Share of each texel's radiance that the specular lobe (GGX, reflectance 0.04) sends to the camera."""
        width = roughness.clip(SMOOTHEST, 1)[:, None] ** 2
        half = DIRECTIONS[None] + self.towards[:, None]
        half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-9)
        high = np.einsum("pi,pdi->pd", self.normal, half).clip(0, 1)
        turned = np.einsum("pi,pdi->pd", self.towards, half).clip(0, 1)
        into = (self.normal @ DIRECTIONS.T).clip(0)
        out = (self.normal * self.towards).sum(1).clip(1e-3, 1)[:, None]
        lobe = width**2 / (np.pi * (high**2 * (width**2 - 1) + 1) ** 2)
        fresnel = NORMAL_INCIDENCE + (1 - NORMAL_INCIDENCE) * (1 - turned) ** 5
        masked = out * np.sqrt(width**2 + (1 - width**2) * into**2) + into * np.sqrt(width**2 + (1 - width**2) * out**2)
        return np.asarray(lobe * fresnel * into / np.maximum(2 * masked, 1e-9) * self.open)


DIRECTIONS: Array = texel_directions(ROWS, COLUMNS).reshape(-1, 3).numpy().astype(float)
SOLID_ANGLES: Array = texel_solid_angles(ROWS, COLUMNS).expand(ROWS, COLUMNS).reshape(-1).numpy().astype(float)


def reduced_light(light: EnvironmentMap) -> Array:
    """Mean radiance over each of the texels [rows, columns, 3]."""
    radiance = light.radiance.double().numpy()
    height, width = radiance.shape[:2]
    weight = np.broadcast_to(texel_solid_angles(height, width).double().numpy()[:, None], (height, width, 1))
    total = cv2.resize(np.ascontiguousarray(radiance * weight), (COLUMNS, ROWS), interpolation=cv2.INTER_AREA)
    return np.asarray(total / cv2.resize(weight.copy(), (COLUMNS, ROWS), interpolation=cv2.INTER_AREA)[..., None])


def lit_points(truths: Sequence[Truth]) -> Lit | None:
    """Points of views with normals; None if there are hardly any."""
    most = min(POINTS_OF_A_VIEW, MOST_POINTS // max(len(truths), 1))
    parts, shown = [], []
    for place, truth in enumerate(truths):
        at = some_pixels(truth.with_normal, most, place)
        position = np.zeros_like(truth.rays)
        if "depth" in truth.maps:
            position = truth.points
            shown.append(position[truth.solid & (truth.maps["depth"][..., 0] > 0)])
        towards = -truth.rays[at] / np.linalg.norm(truth.rays[at], axis=-1, keepdims=True)
        parts.append((np.full(len(at[0]), place), *at, truth.maps["normal"][at], towards, position[at]))
    if sum(len(part[0]) for part in parts) < POINTS_OF_A_VIEW:
        return None
    view, row, column, normal, towards, position = (np.concatenate(each) for each in zip(*parts, strict=True))
    facing = normal @ DIRECTIONS.T > 0
    free = facing & ~_hidden(position, normal, facing, np.concatenate(shown)) if len(shown) == len(truths) else facing
    return Lit(view, (row, column), normal, towards, SOLID_ANGLES * free)


def _hidden(position: Array, normal: Array, facing: NDArray[np.bool_], shown: Array) -> NDArray[np.bool_]:
    """[points, texels]: whether a surface that the views show lies between a point and a texel that it faces."""
    low, cell = shown.min(0), float(np.ptp(shown, axis=0).max()) / CELLS
    cells = np.ceil(np.ptp(shown, axis=0) / cell).astype(int) + 3
    grid = np.zeros(cells, dtype=bool)
    grid[tuple((((shown - low) / cell).astype(int) + 1).T)] = True
    filled, bounds = torch.from_numpy(grid.reshape(-1)), torch.from_numpy(cells)
    point, texel = (torch.from_numpy(each) for each in np.nonzero(facing))
    start = torch.from_numpy(((position - low) / cell + 1 + LEAVING * normal).astype(np.float32))[point]
    step = torch.from_numpy((STRIDE * DIRECTIONS).astype(np.float32))[texel]
    alive, blocked = torch.arange(len(start)), torch.zeros(len(start), dtype=torch.bool)
    rows = torch.tensor([int(cells[1] * cells[2]), int(cells[2]), 1])
    for number in range(1, int(2 * CELLS / STRIDE)):
        at = (start[alive] + number * step[alive]).floor().long()
        inside = ((at >= 0) & (at < bounds)).all(-1)
        alive, at = alive[inside], at[inside]
        hit = filled[(at * rows).sum(-1)]
        blocked[alive[hit]] = True
        alive = alive[~hit]
        if not len(alive):
            break
    hidden = np.zeros(facing.shape, dtype=bool)
    hidden[facing] = blocked.numpy()
    return hidden


DARK, MOST = 0.02, 1.0
"""Radiance below which ratios are noise, as a share of the mean (it is added to both sides), and the natural logarithm
of a ratio that counts at most."""

FITS, ROUGHNESS_FITS = 0.72, 0.62
"""Largest share of the difference that another reading may leave; the same for roughness, which matters less."""

WORST, LEAST = 0.4, 0.03
"""Range of differences that this model of light can judge: below, light is too coarse; above, no reading fits."""


@dataclass(frozen=True)
class Shaded:
    """Images under one light, and the surface that they show."""

    name: str
    """The image's map: ``image`` or ``relit/<light>``."""
    light: str
    radiance: Array
    """Reduced map of light."""
    display: Array
    """Image at the points, display sRGB; empty where linear direct light was stored."""
    indirect: Array
    """Linear light of two or more surfaces at the points, or zero."""
    direct: Array
    """Linear light of one surface, as recorded or as the image without the indirect light."""


@dataclass(frozen=True)
class Materials:
    """The surface at the points, and the share of each texel's light that it sends to the camera."""

    albedo: Array
    diffuse: Array
    specular: Array

    def shade(self, radiance: Array) -> Array:
        """Linear direct light at the points under a map [rows, columns, 3]."""
        texels = radiance.reshape(-1, 3)
        return np.asarray(self.albedo * (self.diffuse @ texels) + self.specular @ texels)


def recorded_lights(evidence: Evidence) -> Iterator[Finding]:
    """Lights, albedo, roughness and images that contradict one another by how the true surfaces are shaded."""
    truths = [truth for truth in evidence.truths if {"albedo", "normal"} <= truth.maps.keys()]
    lit = lit_points(truths)
    if lit is None:
        return
    shaded = _shaded(evidence, truths, lit)
    known = all("roughness" in truth.maps for truth in truths)
    roughness = lit.values(truths, "roughness")[:, 0] if known else np.full(len(lit.view), 0.5)
    materials = Materials(lit.values(truths, "albedo"), lit.diffuse(), lit.specular(roughness))
    wrong = _materials(shaded, lit, materials, roughness)
    if wrong is not None:
        yield wrong
        return
    for each in shaded:
        yield from _light(evidence, each, materials)


def _shaded(evidence: Evidence, truths: Sequence[Truth], lit: Lit) -> list[Shaded]:
    scene = evidence.scene
    lights = {f"relit/{name}": (name, light) for name, light in scene.lights.items()}
    if scene.training_light is not None:
        lights = {"image": ("the training light", scene.training_light)} | lights
    common = set.intersection(*({*truth.maps} for truth in truths))
    found = []
    for name, (light, radiance) in lights.items():
        if name not in common:
            continue
        rest = "indirect" if name == "image" else f"{name}/indirect"
        display = lit.values(truths, name)
        indirect = lit.values(truths, rest) if rest in common else np.zeros_like(display)
        if name == "image" and "direct" in common:
            direct, display = lit.values(truths, "direct"), display[:0]
        else:
            direct = decoded(display) - indirect
        found.append(Shaded(name, light, reduced_light(radiance), display, indirect, direct))
    return found


def difference(shaded: Array, direct: Array) -> float:
    """Mean ratio of two radiances at the points, up to a common factor, as a natural logarithm."""
    floor = DARK * max(float(direct.mean()), 1e-6)
    factor = float(direct.clip(0).mean() / max(float(shaded.mean()), 1e-9))
    ratio = np.log(factor * shaded.clip(0) + floor) - np.log(direct.clip(0) + floor)
    return float(np.abs(ratio - np.median(ratio)).clip(max=MOST).mean())


def _materials(shaded: Sequence[Shaded], lit: Lit, materials: Materials, roughness: Array) -> Finding | None:
    """Albedo or roughness that contradicts the images under every light in the same way."""
    if not shaded:
        return None

    def cost(read: Materials) -> float:
        return float(np.mean([difference(read.shade(each.radiance), each.direct) for each in shaded]))

    own = cost(materials)
    albedo = materials.albedo
    tried = [(f"its albedo has {says}", cost(replace(materials, albedo=read(albedo)))) for says, read in LINEAR]
    if float(np.median(roughness)) > 0.2:
        for says, other in (
            ("roughness is stored as 1 - roughness (glossiness)", 1 - roughness),
            ("roughness is stored squared (alpha of GGX)", np.sqrt(roughness.clip(0))),
            ("roughness is stored as its square root", roughness**2),
        ):
            tried.append((says, cost(replace(materials, specular=lit.specular(other)))))
    says, least = best(tried)
    name, limit = ("albedo", FITS) if "albedo" in says else ("roughness", ROUGHNESS_FITS)
    if not (least < limit * own and least < WORST and own > LEAST):
        return None
    what = f"shading by the recorded lights contradicts the images: it fits if {says}"
    return warning(name, f"{what} (difference {least:.2f} instead of {own:.2f})")


def _light(evidence: Evidence, each: Shaded, materials: Materials) -> Iterator[Finding]:
    def cost(light: Array, direct: Array = each.direct) -> float:
        return difference(materials.shade(light), direct)

    own = cost(each.radiance)
    others = {name: light for name, light in evidence.scene.lights.items() if f"relit/{name}" != each.name}
    if evidence.scene.training_light is not None and each.name != "image":
        others["training"] = evidence.scene.training_light
    tried = [(f"the light {says}", cost(radiance)) for says, radiance in _turned(each.radiance)]
    tried += [(f"the light '{name}'", cost(reduced_light(light))) for name, light in others.items()]
    if len(each.display):
        read_as = [(says, decoded(read(each.display)) - each.indirect) for says, read in DISPLAY]
        tried += [(f"the image with {says}", cost(each.radiance, direct)) for says, direct in read_as]
    elif each.indirect.any():
        tried.append(("direct and indirect light exchanged", cost(each.radiance, each.indirect)))
    says, least = best(tried)
    if least < FITS * own and least < WORST and own > LEAST:
        what = f"shading by {each.light} contradicts it: {says} fits far better"
        yield warning(each.name, f"{what} (difference {least:.2f} instead of {own:.2f})")


def _turned(radiance: Array) -> Iterator[tuple[str, Array]]:
    """The map turned about the vertical in steps of a texel, mirrored, upside down, or lying on its side."""
    for texels in range(1, COLUMNS):
        degrees = 360 * (texels if 2 * texels <= COLUMNS else texels - COLUMNS) / COLUMNS
        yield f"turned by {degrees:g} degrees about the vertical", np.roll(radiance, texels, axis=1)
    yield "mirrored left to right", radiance[:, ::-1]
    yield "mirrored left to right and turned by 180 degrees", np.roll(radiance[:, ::-1], COLUMNS // 2, axis=1)
    yield "upside down", radiance[::-1]
    yield "upside down and mirrored", radiance[::-1, ::-1]
    yield "with red and blue exchanged", radiance[..., ::-1]
