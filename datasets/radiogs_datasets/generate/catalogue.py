"""The scenes that can be generated, by name, as data: solids with their materials, cameras, lights.

Most show one effect each; each further kind has one scene. World units, Z up, everything inside +-1.3. Solids are
closed, face outwards, and neither touch nor overlap (a gap of 2 mm keeps faces from being coplanar); all are
dielectric. Surfaces have one material each, or two between which a pattern of the position chooses.
"""

from radiogs_core.errors import UsageError

from .materials import Material, Patterned
from .patterns import Checker, Noise, Print, Rings, Stripes
from .recipe import Recipe, Rig
from .solids import GAP, Box, Knot, Relief, Sphere, Swell, Turned

WHITE = Material((0.75, 0.75, 0.75), 0.7)
RED = Material((0.65, 0.07, 0.05), 0.8)
GREEN = Material((0.09, 0.5, 0.11), 0.8)
GREY = Material((0.45, 0.45, 0.45), 0.3)
BLUE = Material((0.08, 0.16, 0.6), 0.5)
CHALK = Material((0.75, 0.75, 0.75), 0.8)
SOOT = Material((0.05, 0.05, 0.05), 0.8)
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
AMBER = Material((0.84, 0.68, 0.34), 0.7)
ROSE = Material((0.82, 0.4, 0.36), 0.7)
AQUA = Material((0.4, 0.72, 0.78), 0.7)
PEARL = Material((0.82, 0.8, 0.76), 0.75)
LEAF = Material((0.36, 0.6, 0.2), 0.5)
COBALT = Material((0.07, 0.12, 0.45), 0.1)
GLAZE = Material((0.45, 0.43, 0.38), 0.2)
COPPER = Material((0.4, 0.17, 0.08), 0.3)
JADE = Material((0.18, 0.42, 0.28), 0.08)
PLUM = Material((0.32, 0.08, 0.2), 0.12)
SLATE = Material((0.16, 0.17, 0.19), 0.3)
BONE = Material((0.38, 0.33, 0.26), 0.15)


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
        solids=(*_tiles(0.9, -0.6, -0.5, _FOUR), Sphere((0.0, 0.0, 0.05), 0.5, Material((0.3, 0.3, 0.3), 0.25))),
        rig=Rig(target=(0.0, 0.0, -0.15), radius=4.2, azimuth=(0.0, 360.0), elevation=(10.0, 60.0)),
    ),
    Recipe(
        name="mirror",
        purpose="a smooth dark ball over coloured tiles: nearly all that it shows is specular",
        solids=(*_tiles(0.9, -0.6, -0.5, _FOUR), Sphere((0.0, 0.0, 0.05), 0.5, Material((0.04, 0.04, 0.04), 0.1))),
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

Profile = tuple[tuple[float, float], ...]

VASE: Profile = (
    (0.06, 0.0), (0.16, 0.0), (0.17, 0.01), (0.22, 0.2), (0.24, 0.34), (0.12, 0.5), (0.11, 0.58), (0.16, 0.66),
    (0.16, 0.68), (0.14, 0.68), (0.085, 0.58), (0.09, 0.5), (0.2, 0.34), (0.18, 0.2), (0.1, 0.06), (0.04, 0.05),
)  # fmt: skip
BOWL: Profile = (
    (0.05, 0.0), (0.16, 0.0), (0.16, 0.02), (0.16, 0.03), (0.32, 0.12), (0.41, 0.3), (0.41, 0.33), (0.38, 0.33),
    (0.365, 0.3), (0.28, 0.16), (0.14, 0.08), (0.05, 0.07),
)  # fmt: skip
GOBLET: Profile = (
    (0.05, 0.0), (0.17, 0.0), (0.17, 0.02), (0.05, 0.04), (0.03, 0.1), (0.03, 0.25), (0.06, 0.31), (0.18, 0.4),
    (0.2, 0.55), (0.2, 0.62), (0.17, 0.62), (0.165, 0.55), (0.14, 0.42), (0.06, 0.37), (0.03, 0.37),
)  # fmt: skip
JAR: Profile = (
    (0.06, 0.0), (0.18, 0.0), (0.19, 0.02), (0.26, 0.14), (0.27, 0.28), (0.2, 0.4), (0.17, 0.42), (0.2, 0.44),
    (0.14, 0.5), (0.04, 0.52), (0.03, 0.54), (0.06, 0.58), (0.05, 0.62), (0.02, 0.62),
)  # fmt: skip
PARASOL: Profile = (
    (0.05, 0.0), (0.18, 0.0), (0.18, 0.03), (0.04, 0.04), (0.025, 0.1), (0.025, 0.7), (0.05, 0.74), (0.25, 0.7),
    (0.43, 0.62), (0.45, 0.62), (0.44, 0.66), (0.25, 0.77), (0.06, 0.82), (0.02, 0.83),
)  # fmt: skip
"""VASE to PARASOL: profiles (radius, height) of solids of revolution that stand on the plane z = 0, world units."""


def _scaled(profile: Profile, width: float, height: float) -> Profile:
    return tuple((width * away, height * up) for away, up in profile)


_FRONT = (
    Recipe(
        name="front_plain",
        kind="interior from the front, plain",
        purpose="a niche with plain coloured walls and three objects, seen from its front alone",
        solids=(
            Box((-0.85, -0.8, -0.7), (0.85, 0.55, -0.6), PEARL),
            Box((-0.85, -0.8, -0.598), (0.85, -0.7, 0.6), AMBER),
            Box((-0.85, -0.698, -0.598), (-0.75, 0.55, 0.6), AQUA),
            Box((0.75, -0.698, -0.598), (0.85, 0.55, 0.6), ROSE),
            Box((-0.85, -0.8, 0.602), (0.85, -0.3, 0.7), PEARL),
            Turned((0.36, -0.32, -0.598), _scaled(VASE, 1.2, 1.2), PEARL),
            Sphere((-0.36, -0.34, -0.298), 0.3, LEAF),
            Box((-0.28, 0.08, -0.598), (0.08, 0.38, -0.3), SCARLET),
        ),
        rig=Rig(target=(0.0, -0.1, -0.02), radius=4.2, azimuth=(61.0, 119.0), elevation=(2.0, 28.0)),
    ),
    Recipe(
        name="front_patterned",
        kind="interior from the front, patterned",
        choices="reported only",
        purpose="an open box with patterned walls and a stand with objects, in few views from its front alone",
        solids=(
            Box((-0.8, -0.9, -0.7), (0.6, 0.9, -0.6), Patterned(TILE, OCHRE, Checker(0.3, (0.07, 0.05, -0.97)))),
            Box((-0.8, -0.9, -0.598), (-0.7, 0.9, 0.6), Patterned(PLASTER, TEAL, Stripes((0.0, 0.8, 0.6), 0.28, 0.35))),
            Box((-0.698, -0.9, -0.598), (0.6, -0.8, 0.6), Patterned(SAND, CLAY, Noise(0.7, 0.2, 0.7, 11))),
            Box((-0.698, 0.8, -0.598), (0.6, 0.9, 0.6), Patterned(PLASTER, SAND, Rings((0.0, 0.85, 0.1), 0.2, 0.4))),
            Box(
                (-0.5, -0.4, -0.598), (0.0, 0.4, -0.28),
                Patterned(CREAM, VARNISH, Stripes((0.0, 1.0, 0.0), 0.19, 0.4)),
            ),
            Turned(
                (-0.25, -0.2, -0.278), _scaled(VASE, 0.85, 0.85),
                Patterned(MARBLE, INDIGO, Noise(0.3, 0.1, 1.0, 12)),
            ),
            Sphere((-0.25, 0.2, -0.098), 0.18, Patterned(IVORY, ENAMEL, Rings((-0.1, 0.3, 0.1), 0.1, 0.45))),
            Knot((0.3, 0.3, -0.449), 0.17, 0.085, 0.062, IVORY),
        ),
        rig=Rig(target=(-0.1, 0.0, -0.05), radius=4.2, azimuth=(-29.0, 29.0), elevation=(2.0, 28.0)),
        relight=("sunset", "morning"),
        train=24,
    ),
)  # fmt: skip

_ALL_ROUND = (
    Recipe(
        name="sculpture",
        kind="organic shape under a sunless sky",
        purpose="an organic shape with fine relief and patterned paint, under a sky without a sun",
        solids=(
            Relief(
                (0.0, 0.0, -0.05), 0.5,
                (
                    Swell(30.0, 72.0, 11.0, 1.0), Swell(150.0, 12.0, 10.0, 0.9), Swell(272.0, -8.0, 10.0, 0.95),
                    Swell(28.0, -22.0, 10.0, 0.85), Swell(200.0, -62.0, 9.0, 0.6), Swell(90.0, 25.0, 14.0, -0.3),
                    Swell(210.0, 32.0, 14.0, -0.3), Swell(330.0, 22.0, 14.0, -0.3),
                ),
                0.034, 0.55, 0.21, 21, Patterned(OCHRE, PINE, Noise(0.5, 0.14, 1.2, 22)),
            ),
        ),
        rig=Rig(target=(0.0, 0.0, 0.0), radius=3.9, azimuth=(0.0, 360.0), elevation=(-25.0, 65.0)),
        training_light="veil",
        relight=("sky", "sunset"),
        train=64,
    ),
    Recipe(
        name="glossware",
        kind="glossy vessels",
        purpose="patterned vessels of low roughness: reflections of a structured sky and of one another",
        solids=(
            Box((-0.95, -0.95, -0.6), (0.95, 0.95, -0.5), Patterned(SLATE, BONE, Checker(0.38, (0.03, 0.05, -0.97)))),
            Turned(
                (-0.4, -0.35, -0.498), _scaled(VASE, 1.35, 1.35),
                Patterned(GLAZE, COBALT, Stripes((0.0, 0.0, 1.0), 0.2, 0.45)),
            ),
            Turned((0.38, -0.4, -0.498), BOWL, Patterned(COPPER, PLUM, Noise(0.4, 0.12, 1.0, 31))),
            Turned((0.42, 0.42, -0.498), _scaled(GOBLET, 1.2, 1.2), Patterned(JADE, BONE, Noise(0.35, 0.12, 1.0, 32))),
            Turned(
                (-0.38, 0.45, -0.498), _scaled(JAR, 1.2, 1.2),
                Patterned(GLAZE, PLUM, Rings((-0.7, 0.9, 0.1), 0.2, 0.45)),
            ),
        ),
        rig=Rig(target=(0.0, 0.0, -0.2), radius=4.2, azimuth=(0.0, 360.0), elevation=(10.0, 60.0)),
        training_light="broken",
    ),
    Recipe(
        name="crowd",
        kind="crowded objects, overcast",
        choices="reported only",
        purpose="eight objects that shade one another, thin parts among them, under an overcast sky",
        solids=(
            Box((-1.0, -1.0, -0.7), (1.0, 1.0, -0.6), Patterned(TILE, SAND, Noise(0.8, 0.25, 0.8, 41))),
            Turned(
                (-0.3, 0.45, -0.598), _scaled(PARASOL, 1.1, 1.15),
                Patterned(SCARLET, PLASTER, Rings((-0.3, 0.45, 0.6), 0.2, 0.4)),
            ),
            Box(
                (0.72, -0.75, -0.598), (0.78, -0.15, 0.2),
                Patterned(PLASTER, TEAL, Stripes((0.0, 0.8, 0.6), 0.24, 0.4)),
            ),
            Turned((0.25, -0.5, -0.598), _scaled(GOBLET, 1.1, 1.1), OCHRE),
            Sphere((-0.45, -0.5, -0.348), 0.25, Patterned(MARBLE, INDIGO, Checker(0.16, (0.01, 0.02, 0.03)))),
            Knot((0.52, 0.56, -0.415), 0.2, 0.105, 0.076, IVORY),
            Relief(
                (-0.72, 0.62, -0.448), 0.15, (Swell(60.0, 40.0, 4.0, 0.2), Swell(200.0, 0.0, 6.0, -0.2)),
                0.01, 0.8, 0.4, 42, CLAY,
            ),
            Turned((0.18, -0.06, -0.598), _scaled(BOWL, 0.7, 0.8), Patterned(CREAM, PINE, Noise(0.3, 0.1, 1.0, 43))),
            Box((-0.85, -0.15, -0.598), (-0.8, -0.1, 0.1), VARNISH),
            Box((-0.25, -0.15, -0.598), (-0.2, -0.1, 0.1), VARNISH),
            Box((-0.85, -0.15, 0.102), (-0.2, -0.1, 0.15), VARNISH),
        ),
        rig=Rig(target=(0.0, 0.0, -0.3), radius=4.4, azimuth=(0.0, 360.0), elevation=(12.0, 65.0)),
        training_light="overcast",
        relight=("sky", "sunset"),
    ),
    Recipe(
        name="lamps",
        kind="small lamps at night",
        choices="reported only",
        purpose="several small lamps of colours at night, on a bowl and a dented body: each has a shadow of its own",
        solids=(
            Box(
                (-0.95, -0.95, -0.6), (0.95, 0.95, -0.5),
                Patterned(PLASTER, GREY, Checker(0.38, (0.05, 0.03, -0.97))),
            ),
            Turned(
                (0.28, -0.3, -0.498), _scaled(BOWL, 1.3, 1.5),
                Patterned(PLASTER, ENAMEL, Noise(0.5, 0.15, 1.0, 51)),
            ),
            Relief(
                (-0.4, 0.3, -0.079), 0.42,
                (
                    Swell(300.0, 20.0, 9.0, -0.45), Swell(60.0, 10.0, 9.0, -0.45), Swell(180.0, 15.0, 9.0, -0.45),
                    Swell(0.0, 90.0, 9.0, -0.35),
                ),
                0.006, 0.6, 0.3, 52, Patterned(IVORY, TEAL, Noise(0.4, 0.12, 1.0, 53)),
            ),
            Box((0.45, 0.4, -0.498), (0.75, 0.7, -0.1), CHALK),
        ),
        rig=Rig(target=(0.0, 0.0, -0.2), radius=4.2, azimuth=(0.0, 360.0), elevation=(12.0, 62.0)),
        training_light="lanterns",
        relight=("sky", "overcast"),
    ),
)  # fmt: skip

RECIPES = {recipe.name: recipe for recipe in (*_PLAIN, *_PATTERNED, *_FRONT, *_ALL_ROUND)}


def recipe(name: str) -> Recipe:
    """The recipe of that name. Raises UsageError for an unknown one."""
    if name not in RECIPES:
        raise UsageError(
            f"there is no recipe for a scene '{name}'", "", f"Scenes that can be generated: {', '.join(RECIPES)}."
        )
    return RECIPES[name]
