"""A floor seen from above, and sheets above the camera, which it does not see."""

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from known_ball import CPU, SCENE
from radiogs_baselines.methods.irgs.settings import PRESETS, Variant
from radiogs_baselines.methods.irgs.showing import TrainedIRGS
from radiogs_core.contract import Run
from radiogs_core.on_surfels.model import LitSurfels
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap, texel_directions
from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid, radiance_to_sh, roughness_to_logit

SMOKE = PRESETS["smoke"]
NEAR = 1e-3 / SCENE.extent
"""Start of rays so near to their surfel that they skip only this one."""
UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
ENDLESS = 1e4
"""Scale of a sheet whose opacity is nearly constant up to where rays one degree above the floor's plane hit it."""
OPAQUE = 0.9999


def sheet(
    height: float,
    normal: tuple[float, ...] = UP,
    scale: float = ENDLESS,
    opacity: float = OPAQUE,
    albedo: float = 0.5,
    roughness: float = 0.9,
    radiance: float = 0.0,
    dtype: torch.dtype = torch.float32,
) -> Surfels:
    """One surfel on the z axis; ``radiance`` is the same in all directions."""
    like: dict[str, Any] = {"dtype": dtype}
    x, y, z = normal
    # The shortest rotation from +Z to n is the quaternion (1 + n_z, -n_y, n_x, 0); to -Z half a turn about x.
    rotation = torch.tensor([[0.0, 1.0, 0.0, 0.0]] if z == -1 else [[1 + z, -y, x, 0.0]], **like)
    sh = torch.zeros(1, COEFFICIENTS, 3, **like)
    sh[:, 0] = radiance_to_sh(torch.full((1, 3), radiance, **like))
    return Surfels(
        centre=torch.tensor([[0.0, 0.0, height]], **like),
        rotation=rotation,
        log_scale=torch.full((1, 2), scale, **like).log(),
        opacity_logit=torch.full((1,), inverse_sigmoid(opacity), **like),
        sh=sh,
        albedo_logit=torch.full((1, 3), inverse_sigmoid(albedo), **like),
        roughness_logit=torch.full((1,), roughness_to_logit(roughness), **like),
    )


def together(*surfels: Surfels) -> Surfels:
    """All surfels in one."""
    parts = [each.parameters() for each in surfels]
    return Surfels.of({name: torch.cat([part[name] for part in parts]) for name in parts[0]})


def tiles(**looks: float) -> Surfels:
    """A floor of overlapping coplanar surfels."""
    coordinate = torch.arange(-6, 7) * 0.1
    x, y = (values.flatten() for values in torch.meshgrid(coordinate, coordinate, indexing="ij"))
    tile = sheet(0.0, UP, scale=0.1, opacity=0.9, **looks).take(torch.zeros(len(x), dtype=torch.long))
    return Surfels.of(tile.parameters() | {"centre": torch.stack([x, y, 0 * x], -1)})


def leaning(*albedo: float) -> Surfels:
    """Two surfels of nearly equal weight that lean 60 degrees to either side."""
    lean = 3**0.5 / 2
    return together(
        sheet(0.0, (lean, 0.0, 0.5), scale=1.0, opacity=0.5, albedo=albedo[0]),
        sheet(0.0, (-lean, 0.0, 0.5), scale=1.0, albedo=albedo[1]),
    )


RISING = EnvironmentMap(1 + texel_directions(64, 128)[..., 2:].repeat(1, 1, 3).float())
"""A light of 1 + w_z, under which a Lambert surface of albedo a sends a (1 + 2/3 n_z)."""


def looking_down(height: float = 0.05, size: int = 3, dtype: torch.dtype = torch.float32) -> Camera:
    """A camera above the origin whose middle pixel looks straight down."""
    matrix = torch.eye(4, dtype=dtype)
    matrix[:3, :3] = torch.diag(torch.tensor([1.0, -1.0, -1.0], dtype=dtype))
    matrix[2, 3] = height
    return Camera(matrix, 2.0 * size, 2.0 * size, size / 2, size / 2, size, size)


def grey(radiance: float = 1.0, rows: int = 8) -> EnvironmentMap:
    """A light of constant grey radiance."""
    return EnvironmentMap(torch.full((rows, 2 * rows, 3), radiance))


def trained(surfels: Surfels, light: EnvironmentMap | None = None, samples: int = 64, **turned: Any) -> TrainedIRGS:
    """A model with these surfels, without training; rays skip only the surfel that they leave.

    Relit by 64 rays over the hemisphere and 32 from the light. ``turned``: changed fields of the variant.
    """
    variant = Variant(**{"ray_start": NEAR, "two_sided": False, **turned})
    budget = replace(SMOKE, render_samples=samples, relight_hemisphere_samples=64, relight_light_samples=32)
    model = LitSurfels(surfels, (light or grey()).radiance.to(surfels.centre).log())
    return TrainedIRGS(model, Run(SCENE, variant, budget, 0, CPU))


def own(surfels: Surfels, light: EnvironmentMap, samples: int = 64, **turned: Any) -> dict[str, Tensor]:
    """The middle pixel of every map, under the recovered light."""
    return middle(trained(surfels, light, samples, **turned).prepare())


def relit(surfels: Surfels, light: EnvironmentMap, **turned: Any) -> dict[str, Tensor]:
    """The middle pixel of every map under a new light."""
    return middle(trained(surfels, **turned).prepare(light))


def middle(shown: Any, height: float = 0.05) -> dict[str, Tensor]:
    """Values of the middle pixel of ``looking_down``, divided by its coverage; ``shown``: prepared, or a renderer."""
    maps = getattr(shown, "renderer", shown).render(looking_down(height), "incident")
    seen = {name: values[1, 1] for name, values in maps.items()}
    straight = ("direct", "indirect", "incident", "incident_direct")
    return seen | {name: seen[name] / seen["alpha"] for name in straight if name in seen}
