"""Patterns of the world position as Mitsuba textures, evaluated in Dr.Jit by the formula that is the ground truth."""

# Mitsuba's types exist only once a variant is set, so annotations must not be evaluated here.
from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .materials import Patterned
from .patterns import Array


def textures(finish: Patterned) -> tuple[mi.Texture, mi.Texture]:
    """Albedo and roughness of a finish as textures, to be given to a BSDF; a variant must be set."""

    class Solid(mi.Texture):
        def __init__(self) -> None:
            mi.Texture.__init__(self, mi.Properties())

        def values(self, si: mi.SurfaceInteraction3f) -> tuple[Array, Array, Array, Array]:
            return finish.at(si.p.x, si.p.y, si.p.z, dr)

        def is_spatially_varying(self) -> bool:
            return True

        def to_string(self) -> str:
            return f"{type(self).__name__}[{finish}]"

    class Albedo(Solid):
        def eval(self, si: mi.SurfaceInteraction3f, active: mi.Bool | bool = True) -> mi.Color3f:
            red, green, blue, _ = self.values(si)
            return mi.Color3f(red, green, blue)

    class Roughness(Solid):
        def eval_1(self, si: mi.SurfaceInteraction3f, active: mi.Bool | bool = True) -> mi.Float:
            return self.values(si)[3]

    return Albedo(), Roughness()
