"""The scenes that can be generated, as data: solids with their materials, cameras, lights.

World units, Z up, everything inside +-1.3. Solids are closed, face outwards, and neither touch nor overlap (a gap
of 2 mm keeps faces from being coplanar); all are dielectric. Surfaces here have one material each; those with
patterns are in ``patterned``.
"""

from radiogs_core.errors import UsageError

from .materials import Material
from .patterned import RECIPES as PATTERNED
from .recipe import Recipe, Rig
from .solids import GAP, Box, Sphere

WHITE = Material((0.75, 0.75, 0.75), 0.7)
RED = Material((0.65, 0.07, 0.05), 0.8)
GREEN = Material((0.09, 0.5, 0.11), 0.8)
GREY = Material((0.45, 0.45, 0.45), 0.3)
BLUE = Material((0.08, 0.16, 0.6), 0.5)
CHALK = Material((0.75, 0.75, 0.75), 0.8)
SOOT = Material((0.05, 0.05, 0.05), 0.8)


def _tiles(side: float, low: float, high: float, materials: tuple[tuple[Material, ...], ...]) -> tuple[Box, ...]:
    """A square of tiles around the z axis, rows along +x; each a little lower than the one before."""
    count = len(materials)
    width = (2 * side - (count - 1) * GAP) / count
    return tuple(
        Box(
            (-side + row * (width + GAP), -side + column * (width + GAP), low),
            (-side + row * (width + GAP) + width, -side + column * (width + GAP) + width, high - 1e-3 * place),
            material,
        )
        for place, (row, column, material) in enumerate(
            (row, column, material) for row, line in enumerate(materials) for column, material in enumerate(line)
        )
    )


def _patches(rows: int) -> tuple[tuple[Material, ...], ...]:
    """Albedo over the whole gamut by the golden ratio, roughness from 0.2 to 0.8."""
    return tuple(
        tuple(
            Material(
                tuple(0.1 + 0.7 * ((place * step) % 1) for step in (0.618034, 0.754878, 0.569840)),  # type: ignore[arg-type]
                round(0.2 + 0.6 * ((place * 0.381966) % 1), 3),
            )
            for place in range(rows * line + 1, rows * line + rows + 1)
        )
        for line in range(rows)
    )


_FOUR = ((RED, WHITE), (GREEN, BLUE))

_PLAIN = (
    Recipe(
        name="corner",
        purpose="strong coloured inter-reflection between a white floor, two walls and two spheres",
        solids=(
            Box((-1.1, -1.1, -0.8), (1.0, 1.0, -0.7), WHITE),
            Box((-1.1, -1.0, -0.698), (-1.0, 1.0, 0.6), RED),
            Box((-1.1, -1.1, -0.698), (1.0, -1.002, 0.6), GREEN),
            Sphere((-0.35, -0.4, -0.298), 0.4, GREY),
            Sphere((0.3, 0.25, -0.418), 0.28, BLUE),
        ),
        rig=Rig(target=(-0.1, -0.1, -0.25), radius=4.6, azimuth=(-5.0, 95.0), elevation=(12.0, 65.0)),
        training_light="sky",
        relight=("sunset", "overcast"),
    ),
    Recipe(
        name="convex",
        purpose="no inter-reflection and no shadow: what concerns only indirect light must not change anything",
        solids=(Sphere((0.0, 0.0, 0.0), 1.0, Material((0.6, 0.35, 0.2), 0.5)),),
        rig=Rig(target=(0.0, 0.0, 0.0), radius=4.2, azimuth=(0.0, 360.0), elevation=(-20.0, 65.0)),
        training_light="sky",
        relight=("sunset", "overcast"),
    ),
    Recipe(
        name="red_white",
        purpose="red light on white: what is recovered as the white box's albedo must stay white",
        solids=(
            Box((-0.9, -0.8, -0.6), (0.9, 0.8, -0.5), CHALK),
            Box((-0.6, -0.5, -0.498), (-0.05, 0.5, 0.35), RED),
            Box((-0.048, -0.4, -0.498), (0.55, 0.4, -0.2), CHALK),
        ),
        rig=Rig(target=(0.0, 0.0, -0.2), radius=4.2, azimuth=(-80.0, 80.0), elevation=(15.0, 65.0)),
        training_light="sky",
        relight=("sunset", "overcast"),
    ),
    Recipe(
        name="occluder",
        purpose="a hard shadow without inter-reflection: visibility must not end up in the albedo",
        solids=(
            Box((-0.95, -0.95, -0.6), (0.95, 0.95, -0.5), Material((0.6, 0.55, 0.5), 0.8)),
            Box((-0.4, -0.4, 0.0), (0.4, 0.4, 0.06), SOOT),
        ),
        rig=Rig(target=(0.0, 0.0, -0.3), radius=4.2, azimuth=(0.0, 360.0), elevation=(25.0, 70.0)),
        training_light="sunset",
        relight=("sky", "overcast"),
    ),
    Recipe(
        name="bowl",
        purpose="a deep white basin: light that has met many surfaces",
        solids=(
            Box((-0.7, -0.7, -0.6), (0.7, 0.7, -0.5), Material((0.8, 0.8, 0.8), 0.7)),
            Box((-0.7, -0.7, -0.498), (-0.6, 0.7, 0.4), Material((0.8, 0.8, 0.8), 0.7)),
            Box((0.6, -0.7, -0.498), (0.7, 0.7, 0.399), Material((0.8, 0.8, 0.8), 0.7)),
            Box((-0.598, -0.7, -0.498), (0.598, -0.6, 0.398), Material((0.8, 0.75, 0.7), 0.7)),
            Box((-0.598, 0.6, -0.498), (0.598, 0.7, 0.397), Material((0.8, 0.75, 0.7), 0.7)),
        ),
        rig=Rig(target=(0.0, 0.0, -0.1), radius=4.0, azimuth=(0.0, 360.0), elevation=(35.0, 80.0)),
        training_light="sky",
        relight=("sunset", "overcast"),
    ),
    Recipe(
        name="glossy",
        purpose="a rough-glossy ball over coloured tiles: reflections that move with the view",
        solids=(
            *_tiles(0.9, -0.6, -0.5, _FOUR),
            Sphere((0.0, 0.0, 0.05), 0.5, Material((0.3, 0.3, 0.3), 0.25)),
        ),
        rig=Rig(target=(0.0, 0.0, -0.15), radius=4.2, azimuth=(0.0, 360.0), elevation=(10.0, 60.0)),
        training_light="sky",
        relight=("sunset", "overcast"),
    ),
    Recipe(
        name="mirror",
        purpose="a smooth dark ball over coloured tiles: nearly all that it shows is specular",
        solids=(
            *_tiles(0.9, -0.6, -0.5, _FOUR),
            Sphere((0.0, 0.0, 0.05), 0.5, Material((0.04, 0.04, 0.04), 0.1)),
        ),
        rig=Rig(target=(0.0, 0.0, -0.15), radius=4.2, azimuth=(0.0, 360.0), elevation=(10.0, 60.0)),
        training_light="sky",
        relight=("sunset", "overcast"),
    ),
    Recipe(
        name="wire",
        purpose="bars as thin as a pixel and their shadows",
        solids=(
            Box((-0.9, -0.9, -0.6), (0.9, 0.9, -0.5), CHALK),
            *(Box((-0.8, 0.3 * place - 0.03, -0.1), (0.8, 0.3 * place + 0.03, -0.04), BLUE) for place in range(-2, 3)),
        ),
        rig=Rig(target=(0.0, 0.0, -0.35), radius=4.2, azimuth=(0.0, 360.0), elevation=(25.0, 70.0)),
        training_light="sky",
        relight=("sunset", "overcast"),
    ),
    Recipe(
        name="patchwork",
        purpose="many materials and no light between them: what separates albedo from roughness by itself",
        solids=_tiles(0.9, -0.2, -0.05, _patches(4)),
        rig=Rig(target=(0.0, 0.0, -0.12), radius=4.2, azimuth=(0.0, 360.0), elevation=(25.0, 75.0)),
        training_light="sky",
        relight=("sunset", "overcast"),
    ),
)

RECIPES = {recipe.name: recipe for recipe in (*_PLAIN, *PATTERNED)}


def recipe(name: str) -> Recipe:
    """The recipe of that name. Raises UsageError for an unknown one."""
    if name not in RECIPES:
        raise UsageError(
            f"there is no recipe for a scene '{name}'", "", f"Scenes that can be generated: {', '.join(RECIPES)}."
        )
    return RECIPES[name]
