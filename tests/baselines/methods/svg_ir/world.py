"""A small floor and sheets above it, traced, shaded and rendered by SVG-IR."""

from typing import Any

from torch import Tensor

from baselines.methods.irgs.world import DOWN, grey, middle, sheet, together
from radiogs_baselines.methods.svg_ir.model import Model
from radiogs_baselines.methods.svg_ir.shading import bounced, materials_of
from radiogs_baselines.methods.svg_ir.showing import Lit, Renderer
from radiogs_baselines.methods.svg_ir.table import Table, Walk, table_of
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels

HOP = 0.2
DISTANCE = 1.5
SMALL = 0.0005
"""Scale of a floor so small that rays of a sheet above it miss it."""


def walk(**changes: Any) -> Walk:
    """Settings with hops of 0.2, as published, that start just above the surfel."""
    return Walk(**{"start": 1e-3, "gap": 1e-3, "hop": HOP, "opaque": 0.2, "radiance_limit": 10.0, **changes})


def floor(albedo: float = 0.5, scale: float = SMALL) -> Surfels:
    """A floor at the origin."""
    return sheet(0.0, scale=scale, albedo=albedo)


def above(way: float, **looks: float) -> Surfels:
    """A sheet that the floor's ray of ``first_ray`` hits at distance ``way``; the ray leaves at 60 degrees."""
    return sheet(way / 2, DOWN, **looks)


def first_ray(*surfels: Surfels, **changes: Any) -> Table:
    """Table with one ray of each surfel."""
    return table_of(together(*surfels), walk(**changes), 1, 0)


def model_of(surfels: Surfels, light: EnvironmentMap, vertices: int = 4, ratio: float = 1.0) -> Model:
    """A model whose vertices all have their surfel's material."""
    return Model(
        surfels=surfels,
        cached=surfels,
        vertex_albedo_logit=surfels.albedo_logit[:, None].repeat(1, vertices, 1),
        vertex_roughness_logit=surfels.roughness_logit[:, None].repeat(1, vertices),
        vertex_offset=surfels.centre.new_zeros(len(surfels), vertices, 3),
        log_environment=light.radiance.to(surfels.centre).log(),
        ratio=surfels.centre.new_tensor(ratio),
    )


def shown(model: Model, table: Table, environment: Tensor, factor: Tensor | float) -> dict[str, Tensor]:
    """The middle pixel of every map, divided by its coverage."""
    lit = Lit(environment, table, factor)
    return middle(Renderer(model, materials_of(model, model.albedo), lit, DISTANCE), 0.002)


def own(surfels: Surfels, ratio: float = 1.0, samples: int = 64, **changes: Any) -> dict[str, Tensor]:
    """``shown`` under a recovered light of constant radiance 1."""
    model = model_of(surfels, grey(), ratio=ratio)
    return shown(model, table_of(surfels, walk(**changes), samples, 0), model.environment, model.ratio)


def relit(surfels: Surfels, light: EnvironmentMap, samples: int = 64) -> Table:
    """The table under a new light."""
    model = model_of(surfels, grey())
    table = table_of(surfels, walk(), samples, 0)
    return table.with_radiance(bounced(materials_of(model, model.albedo), table, light.radiance, DISTANCE))
