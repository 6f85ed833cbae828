"""Lights that a command takes from a file: how they are put into the scene's world, and how strong they are."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from .values import factor, from_text

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

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
    """Let the map's top be this direction of the scene's world: X, Y, Z, --up=-X, --up=-Y, --up=-Z, or three numbers
    such as 0,0.6,0.8 (default: auto, which is Z where the scene has lights of its own, else the upward direction of its
    cameras, as in `view`)."""
    turn: float = 0.0
    """Turn the light by so many degrees about up, counter-clockwise seen from above."""
    strength: Annotated[float, from_text(factor)] = 1.0
    """Multiply the light by this."""

    @property
    def marks(self) -> str:
        """The ending of a folder of renders that names these options; empty where none is given."""
        up = "" if self.up is None else "_up" + ",".join(f"{each:g}" for each in self.up)
        turn = f"_turn{self.turn:g}" if self.turn else ""
        return f"{up}{turn}" + (f"_strength{self.strength:g}" if self.strength != 1 else "")


AS_IT_LIES = Placing()


def placed(placing: Placing, scene: "Scene", light: "EnvironmentMap") -> "tuple[EnvironmentMap, str]":
    """The light of a file in the scene's world, and a sentence on how it lies there."""
    import torch

    from radiogs_core.scene.placed_light import placed_light

    from ..initial_viewpoint import upwards

    up = upwards(scene) if placing.up is None else torch.tensor(placing.up)
    stood, to_map = placed_light(light, up, placing.turn, placing.strength)
    chosen = "" if placing.up is not None else "; another up: --up AXIS"
    said = f"the map's top is {named(to_map[2])} of the scene's world, its centre column {named(to_map[0])}{chosen}"
    return stood, said


def named(direction: "Float[Tensor, '3']") -> str:
    """A unit direction, by the name of the axis that it lies on."""
    for name, values in AXES.items():
        along = sum(float(each) * value for each, value in zip(direction, values, strict=True))
        if abs(along) > 1 - 1e-6:
            return f"{'+' if along > 0 else '-'}{name}"
    return f"({', '.join(f'{float(each):.2f}' for each in direction)})"
