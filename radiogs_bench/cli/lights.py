"""Lights that a command takes, maps and lamps: how they are put into the scene's world, and how strong they are."""

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from radiogs_core.errors import UsageError

from .values import factor, finite, from_every_text, from_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float
    from torch import Tensor

    from radiogs_core.scene.lamps import Lamp
    from radiogs_core.scene.light import EnvironmentMap
    from radiogs_core.scene.scene import Scene

AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


def axis(text: str) -> tuple[float, float, float] | None:
    """A direction of the world, by the name of an axis or as three numbers; None for ``auto``."""
    if text == "auto":
        return None
    sign, name = (-1.0, text[1:]) if text.startswith("-") else (1.0, text.removeprefix("+"))
    if name.upper() in AXES:
        x, y, z = AXES[name.upper()]
        return sign * x + 0.0, sign * y + 0.0, sign * z + 0.0
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"'{text}' is neither auto, an axis such as Y or -Y, nor x,y,z") from None
    if not 0 < math.hypot(x, y, z) < math.inf:
        raise ValueError(f"'{text}' is no direction: its length has to be finite and above zero")
    return x, y, z


@Parameter(name="*")
@dataclass(frozen=True)
class Placing:
    """The options of a command that takes a light from a file."""

    up: Annotated[tuple[float, float, float] | None, from_text(axis), Parameter(metavar="AXIS|auto")] = None
    """Let the top of the map, and the zenith of suns, be this direction of the world: X, Y, Z, --up=-X, --up=-Y,
    --up=-Z, or three numbers such as 0,0.6,0.8 (default: auto, which is Z where the scene has lights of its own, else
    the upward direction of its cameras, as in `view`)."""
    turn: float = 0.0
    """Turn the map and the suns by so many degrees about up, counter-clockwise seen from above."""
    strength: Annotated[float, from_text(factor)] = 1.0
    """Multiply the light by this."""

    @property
    def marks(self) -> str:
        """Ending of the name of a folder of renders, which names these options; empty if none is given."""
        up = "" if self.up is None else "_up" + ",".join(f"{each:g}" for each in self.up)
        turn = f"_turn{self.turn:g}" if self.turn else ""
        return f"{up}{turn}" + (f"_strength{self.strength:g}" if self.strength != 1 else "")


AS_IT_LIES = Placing()

FORMS = {
    "point": "X,Y,Z[,INTENSITY]",
    "spot": "X,Y,Z,TO_X,TO_Y,TO_Z,INNER,OUTER[,INTENSITY]",
    "sun": "AZIMUTH,ELEVATION[,INTENSITY]",
}
"""How each kind of lamp is written as an option; its intensity is one number, or one number per channel."""


def lamp(kind: str, text: str) -> "tuple[str, Lamp]":
    """Parse a lamp from a list of numbers in the form of its kind; also returns the lamp's name in folders of renders.

    Raises ValueError for a list of another form or an invalid lamp.
    """
    from radiogs_core.scene.lamps import PointLamp, SpotLamp, Sun

    found, name = [finite(each) for each in text.split(",")], f"{kind}{text}"
    places = {"point": 3, "spot": 8, "sun": 2}[kind]
    strength: dict[str, Any] = {}
    if len(found) == places + 1:
        strength = {"intensity": found[-1]}
    elif len(found) == places + 3:
        strength = {"intensity": 1.0, "colour": tuple(found[-3:])}
    elif len(found) != places:
        raise ValueError(f"'{text}' is not {FORMS[kind]}, with one number or R,G,B for INTENSITY")
    try:
        if kind == "sun":
            return name, Sun(azimuth=found[0], elevation=found[1], **strength)
        x, y, z = found[:3]
        if kind == "point":
            return name, PointLamp(position=(x, y, z), **strength)
        to_x, to_y, to_z, inner, outer = found[3:8]
        return name, SpotLamp(position=(x, y, z), target=(to_x, to_y, to_z), inner=inner, outer=outer, **strength)
    except UsageError as refused:
        raise ValueError(f"'{text}': {refused.what}. {refused.why}".strip()) from refused


def lamp_option(kind: str) -> tuple[Parameter, Parameter]:
    """An option that describes lamps of a kind and may be repeated."""
    return from_every_text(partial(lamp, kind)), Parameter(metavar=FORMS[kind], allow_leading_hyphen=True)


@Parameter(name="*")
@dataclass(frozen=True)
class Lamps:
    """The options of a command that takes lamps."""

    light: Path | None = None
    """Light by the lamps of this .toml or .json file (docs/datasets.md, "Lamps")."""
    point: Annotated[tuple[Any, ...], *lamp_option("point")] = ()
    """Light by a lamp at this position of the scene's world, with this radiant intensity in W/sr, or R,G,B (default:
    pi). A world unit is a metre. This option may be repeated, as --spot and --sun may, with or without --envmap."""
    spot: Annotated[tuple[Any, ...], *lamp_option("spot")] = ()
    """Light by a spot lamp that shines at the point TO: whole within INNER degrees of its axis, none beyond OUTER."""
    sun: Annotated[tuple[Any, ...], *lamp_option("sun")] = ()
    """Light by a sun at these degrees (azimuth from +X towards +Y), with this irradiance in W/m^2, or R,G,B, of what
    faces it (default: pi, which makes white paper white)."""

    @property
    def names(self) -> list[str]:
        """The names of the lamps that were given as options."""
        return [name for name, _ in (*self.point, *self.spot, *self.sun)]

    def found(self) -> "list[Lamp]":
        """All lamps, the file's first. Raises UsageError and DataError as ``read_lamps`` does."""
        from radiogs_datasets.lights import read_lamps

        read = () if self.light is None else read_lamps(self.light)
        return [*read, *(each for _, each in (*self.point, *self.spot, *self.sun))]


NO_LAMPS = Lamps()


def placed(placing: Placing, scene: "Scene", light: "EnvironmentMap") -> "tuple[EnvironmentMap, str]":
    """A file's light in the scene's world, and a sentence on its orientation there."""
    from radiogs_core.scene.placed_light import placed_light

    stood, to_map = placed_light(light, up_of(placing, scene), placing.turn, placing.strength)
    said = f"the map's top is {named(to_map[2])} of the scene's world, its centre column {named(to_map[0])}"
    return stood, said + another_up(placing)


def placed_lamps(placing: Placing, scene: "Scene", lamps: "Sequence[Lamp]") -> "tuple[tuple[Lamp, ...], list[str]]":
    """Lamps times the strength of ``placing``, suns turned into the scene's world, and sentences on both."""
    from radiogs_core.scene.lamps import Sun
    from radiogs_core.scene.placed_light import rotation_to_map

    to_map = rotation_to_map(up_of(placing, scene), placing.turn)
    stood = tuple(each.turned(to_map) if isinstance(each, Sun) else each for each in lamps)
    said = f"suns: the zenith is {named(to_map[2])} of the scene's world, azimuth 0 {named(to_map[0])}"
    suns = any(isinstance(each, Sun) for each in lamps)
    return tuple(each.times(placing.strength) for each in stood), [said + another_up(placing)] if suns else []


def up_of(placing: Placing, scene: "Scene") -> "Float[Tensor, '3']":
    """The upward direction of the scene's world, by which lights are oriented."""
    import torch

    from ..initial_viewpoint import upwards

    return upwards(scene) if placing.up is None else torch.tensor(placing.up)


def another_up(placing: Placing) -> str:
    """A sentence on the upward direction that was found, followed by how to choose another one."""
    return "" if placing.up is not None else "; another up: --up AXIS"


def named(direction: "Float[Tensor, '3']") -> str:
    """Name of the axis that a unit direction lies along, else its components."""
    for name, values in AXES.items():
        along = sum(float(each) * value for each, value in zip(direction, values, strict=True))
        if abs(along) > 1 - 1e-6:
            return f"{'+' if along > 0 else '-'}{name}"
    return f"({', '.join(f'{float(each):.2f}' for each in direction)})"
