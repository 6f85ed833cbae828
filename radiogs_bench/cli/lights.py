"""Lights that a command takes from a file: how they are stood in the scene's world, and how strong they are."""

import argparse
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from radiogs_core.scene.light import EnvironmentMap
    from radiogs_core.scene.scene import Scene

AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


def add_light_options(parser: argparse.ArgumentParser) -> None:
    """Declare ``--up``, ``--turn`` and ``--strength``, for commands that take a light from a file."""
    parser.add_argument(
        "--up", type=axis, metavar="AXIS|auto",
        help="Let the map's top be this direction of the scene's world: X, Y, Z, --up=-X, --up=-Y, --up=-Z, or three"
        " numbers such as 0,0.6,0.8 (default: auto, which is Z where the scene has lights of its own, else the upward"
        " direction of its cameras, as in `view`).",
    )  # fmt: skip
    parser.add_argument(
        "--turn", type=finite, default=0.0, metavar="DEGREES",
        help="Turn the light about up, counter-clockwise seen from above (default: 0).",
    )  # fmt: skip
    parser.add_argument(
        "--strength", type=factor, default=1.0, metavar="FACTOR", help="Multiply the light by this (default: 1)."
    )


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
        raise argparse.ArgumentTypeError(f"'{text}' is neither auto, an axis such as Y or -Y, nor x,y,z") from None
    if not 0 < math.hypot(x, y, z) < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}' is no direction: its length has to be finite and above zero")
    return x, y, z


def finite(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a finite number")
    return value


def factor(text: str) -> float:
    """A finite number above zero."""
    value = finite(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"'{text}': a factor is above zero")
    return value


def placed(options: argparse.Namespace, scene: "Scene", light: "EnvironmentMap") -> "tuple[EnvironmentMap, str]":
    """The light of a file in the scene's world, as the options say, and a sentence on how it stands there."""
    import torch

    from radiogs_core.scene.placed_light import placed_light

    from ..initial_viewpoint import upwards

    up = upwards(scene) if options.up is None else torch.tensor(options.up)
    stood, to_map = placed_light(light, up, options.turn, options.strength)
    chosen = "" if options.up is not None else "; another up: --up AXIS"
    said = f"the map's top is {named(to_map[2])} of the scene's world, its centre column {named(to_map[0])}{chosen}"
    return stood, said


def named(direction: "Float[Tensor, '3']") -> str:
    """A unit direction, by the name of the axis that it lies on."""
    for name, values in AXES.items():
        along = sum(float(each) * value for each, value in zip(direction, values, strict=True))
        if abs(along) > 1 - 1e-6:
            return f"{'+' if along > 0 else '-'}{name}"
    return f"({', '.join(f'{float(each):.2f}' for each in direction)})"


def marks(options: argparse.Namespace) -> str:
    """The ending of a folder of renders that names these options; empty where none is given."""
    up = "" if options.up is None else "_up" + ",".join(f"{each:g}" for each in options.up)
    turn = f"_turn{options.turn:g}" if options.turn else ""
    return f"{up}{turn}" + (f"_strength{options.strength:g}" if options.strength != 1 else "")
