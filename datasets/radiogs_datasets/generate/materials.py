"""Materials of solids: one material, or two between which a pattern of the world position chooses."""

from __future__ import annotations

from dataclasses import dataclass, replace

from .patterns import Arithmetic, Array, Pattern

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """Linear diffuse albedo and perceptual roughness (alpha_GGX = r^2).

    ``specular``: the part of the BRDF's specular lobe that is rendered; 0 is Lambert, which all renderers have.
    """

    albedo: Colour
    roughness: float
    specular: float = 1.0

    def at(self, x: Array, y: Array, z: Array, maths: Arithmetic) -> tuple[Array, Array, Array, Array]:
        """Albedo (three values) and roughness at world positions, arrays of the kind of the coordinates."""
        red, green, blue = (x * 0 + value for value in self.albedo)
        return red, green, blue, x * 0 + self.roughness

    def without_diffuse(self) -> Material:
        """The same specular lobe over an albedo of zero."""
        return replace(self, albedo=(0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Patterned:
    """``first`` where the pattern is 0, ``second`` where it is 1, and linear between them; see ``patterns``.

    Both have the same part of the specular lobe.
    """

    first: Material
    second: Material
    pattern: Pattern

    def at(self, x: Array, y: Array, z: Array, maths: Arithmetic) -> tuple[Array, Array, Array, Array]:
        """As ``Material.at``."""
        share = self.pattern.share(x, y, z, maths)
        ends = zip(
            (*self.first.albedo, self.first.roughness), (*self.second.albedo, self.second.roughness), strict=True
        )
        red, green, blue, roughness = (first + share * (second - first) for first, second in ends)
        return red, green, blue, roughness

    def without_diffuse(self) -> Patterned:
        """The same specular lobes over an albedo of zero."""
        return Patterned(self.first.without_diffuse(), self.second.without_diffuse(), self.pattern)


Finish = Material | Patterned
