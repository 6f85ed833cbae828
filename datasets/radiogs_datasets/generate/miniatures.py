"""Scenes of one effect each, as data: solids with their materials, cameras, lights.

World units, Z up, everything inside +-1.3. Solids are closed, face outwards, and neither touch nor overlap (a gap
of 2 mm keeps faces from being coplanar); all are dielectric. Surfaces have one material each, or two between which a
pattern of the position chooses.
"""

from .materials import Material, Patterned
from .patterns import Checker, Noise, Print, Rings, Stripes
from .recipe import Recipe, Rig
from .solids import GAP, Box, Knot, Sphere

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

CORNER = Recipe(
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
)

_PLAIN = (
    CORNER,
    Recipe(
        name="convex",
        purpose="no inter-reflection and no shadow: what concerns only indirect light must not change anything",
        solids=(Sphere((0.0, 0.0, 0.0), 1.0, Material((0.6, 0.35, 0.2), 0.5)),),
        rig=Rig(target=(0.0, 0.0, 0.0), radius=4.2, azimuth=(0.0, 360.0), elevation=(-20.0, 65.0)),
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
    ),
    Recipe(
        name="glossy",
        purpose="a rough-glossy ball over coloured tiles: reflections that move with the view",
        solids=(
            *_tiles(0.9, -0.6, -0.5, _FOUR),
            Sphere((0.0, 0.0, 0.05), 0.5, Material((0.3, 0.3, 0.3), 0.25)),
        ),
        rig=Rig(target=(0.0, 0.0, -0.15), radius=4.2, azimuth=(0.0, 360.0), elevation=(10.0, 60.0)),
    ),
    Recipe(
        name="mirror",
        purpose="a smooth dark ball over coloured tiles: nearly all that it shows is specular",
        solids=(
            *_tiles(0.9, -0.6, -0.5, _FOUR),
            Sphere((0.0, 0.0, 0.05), 0.5, Material((0.04, 0.04, 0.04), 0.1)),
        ),
        rig=Rig(target=(0.0, 0.0, -0.15), radius=4.2, azimuth=(0.0, 360.0), elevation=(10.0, 60.0)),
    ),
    Recipe(
        name="wire",
        purpose="bars as thin as a pixel and their shadows",
        solids=(
            Box((-0.9, -0.9, -0.6), (0.9, 0.9, -0.5), CHALK),
            *(Box((-0.8, 0.3 * place - 0.03, -0.1), (0.8, 0.3 * place + 0.03, -0.04), BLUE) for place in range(-2, 3)),
        ),
        rig=Rig(target=(0.0, 0.0, -0.35), radius=4.2, azimuth=(0.0, 360.0), elevation=(25.0, 70.0)),
    ),
    Recipe(
        name="patchwork",
        purpose="many materials and no light between them: what separates albedo from roughness by itself",
        solids=_tiles(0.9, -0.2, -0.05, _patches(4)),
        rig=Rig(target=(0.0, 0.0, -0.12), radius=4.2, azimuth=(0.0, 360.0), elevation=(25.0, 75.0)),
    ),
)


PLASTER = Material((0.8, 0.78, 0.74), 0.8)
VARNISH = Material((0.62, 0.3, 0.14), 0.35)
TILE = Material((0.7, 0.69, 0.64), 0.3)
CLAY = Material((0.66, 0.28, 0.16), 0.75)
TEAL = Material((0.22, 0.56, 0.55), 0.4)
PINE = Material((0.08, 0.32, 0.3), 0.65)
SAND = Material((0.78, 0.66, 0.44), 0.35)
KRAFT = Material((0.72, 0.58, 0.38), 0.8)
INK = Material((0.04, 0.04, 0.06), 0.25)
PAPER = Material((0.76, 0.75, 0.72), 0.85)
ENAMEL = Material((0.6, 0.1, 0.08), 0.25)
MARBLE = Material((0.66, 0.66, 0.68), 0.3)
LIME = Material((0.74, 0.73, 0.7), 0.75)
SKY = Material((0.38, 0.56, 0.68), 0.6)
CREAM = Material((0.7, 0.66, 0.56), 0.4)
BRICK = Material((0.66, 0.22, 0.1), 0.5)
SCARLET = Material((0.8, 0.08, 0.05), 0.6)
OCHRE = Material((0.8, 0.42, 0.07), 0.6)
IVORY = Material((0.72, 0.69, 0.62), 0.3)
INDIGO = Material((0.12, 0.16, 0.5), 0.3)

LEFT, UP = (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)

_PATTERNED = (
    Recipe(
        name="niche",
        purpose="a deep niche with a pattern on every wall: indirect light that lies over varying materials",
        solids=(
            Box((-0.8, -0.8, -0.7), (0.8, 0.6, -0.6), Patterned(TILE, CLAY, Checker(0.2, (0.05, 0.03, -0.95)))),
            Box((-0.8, -0.8, -0.598), (0.8, -0.7, 0.6), Patterned(PLASTER, TEAL, Noise(0.9, 0.25, 0.8, 1))),
            Box((-0.8, -0.698, -0.598), (-0.7, 0.6, 0.6), Patterned(PLASTER, CLAY, Stripes((0.0, 0.6, 0.8), 0.3, 0.4))),
            Box((0.7, -0.698, -0.598), (0.8, 0.6, 0.6), Patterned(SAND, PLASTER, Noise(0.6, 0.15, 0.8, 2))),
            Box((-0.8, -0.8, 0.602), (0.8, -0.2, 0.7), PLASTER),
            Sphere((0.05, 0.0, -0.238), 0.36, Patterned(MARBLE, ENAMEL, Rings((-0.3, 0.3, 0.3), 0.18, 0.45))),
        ),
        rig=Rig(target=(0.0, -0.05, -0.05), radius=4.2, azimuth=(50.0, 130.0), elevation=(5.0, 50.0)),
    ),
    Recipe(
        name="knot",
        purpose="a knotted mesh before patterned walls: shape, self-shadowing and varying materials at once",
        solids=(
            Box((-0.9, -0.9, -0.7), (0.9, 0.9, -0.6), Patterned(TILE, CLAY, Checker(0.25, (0.03, 0.07, -0.9)))),
            Box(
                (-0.9, -0.9, -0.598), (-0.8, 0.9, 0.5),
                Patterned(PLASTER, VARNISH, Stripes((0.0, 0.0, 1.0), 0.24, 0.35)),
            ),
            Box((-0.798, -0.9, -0.598), (0.9, -0.8, 0.5), Patterned(SAND, PLASTER, Noise(0.7, 0.15, 0.8, 3))),
            Knot((0.04, 0.04, -0.215), 0.43, 0.24, 0.14, Patterned(MARBLE, PINE, Noise(0.55, 0.16, 1.0, 4))),
        ),
        rig=Rig(target=(-0.05, -0.05, -0.2), radius=4.4, azimuth=(-5.0, 95.0), elevation=(12.0, 65.0)),
    ),
    Recipe(
        name="alcove",
        purpose="a bright room for pictures: sun on one wall, whose colour lights all that is in shade",
        solids=(
            Box((-1.1, -0.95, -0.8), (1.1, 0.75, -0.7), Patterned(CREAM, BRICK, Checker(0.25, (0.04, 0.02, -1.0)))),
            Box((-1.1, -0.95, -0.698), (1.1, -0.85, 0.75), Patterned(LIME, SKY, Stripes((1.0, 0.0, 0.0), 0.3, 0.4))),
            Box((-1.1, -0.848, -0.698), (-1.0, 0.7, 0.75), Patterned(SCARLET, OCHRE, Noise(0.7, 0.2, 0.9, 5))),
            Box((1.0, -0.848, -0.698), (1.1, 0.7, 0.75), Patterned(LIME, SKY, Noise(0.6, 0.2, 0.6, 6))),
            Box((-1.1, -0.95, 0.752), (1.1, -0.4, 0.84), LIME),
            Box(
                (-0.62, -0.72, -0.698), (0.62, -0.12, -0.4),
                Patterned(LIME, INK, Print("RADIOGS", (0.44, 0.0, -0.62), LEFT, UP, 0.14, 0.032)),
            ),
            Knot((0.0, -0.2, -0.085), 0.36, 0.2, 0.11, IVORY),
            Sphere((0.72, 0.2, -0.478), 0.22, LIME),
            Sphere((-0.68, 0.28, -0.498), 0.2, Patterned(IVORY, INDIGO, Rings((-0.35, 0.6, -0.2), 0.13, 0.45))),
        ),
        rig=Rig((0.0, -0.1, -0.02), 5.0, azimuth=(58.0, 122.0), elevation=(5.0, 42.0), field_of_view=33.0),
        relight=("morning",),
    ),
    Recipe(
        name="print",
        purpose="glossy ink on matt paper: fine patterns whose roughness changes with the albedo",
        solids=(
            Box(
                (-0.95, -0.95, -0.6), (0.95, 0.95, -0.5),
                Patterned(PAPER, INK, Print("RADIO", (-0.55, -0.85, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.3, 0.06)),
            ),
            Box(
                (-0.75, -0.1, -0.498), (-0.15, 0.5, 0.1),
                Patterned(KRAFT, INK, Print("GS", (-0.7, 0.0, -0.4), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.35, 0.07)),
            ),
            Sphere((0.4, 0.3, -0.138), 0.36, Patterned(PAPER, ENAMEL, Rings((0.4, 0.0, 0.2), 0.14, 0.45))),
        ),
        rig=Rig(target=(0.0, 0.0, -0.3), radius=4.2, azimuth=(0.0, 360.0), elevation=(20.0, 70.0)),
        training_light="sunset",
        relight=("sky", "overcast"),
    ),
)  # fmt: skip


SINGLE_EFFECTS = (*_PLAIN, *_PATTERNED)
