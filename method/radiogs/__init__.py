"""RadioGS: radiometrically consistent Gaussian surfels for inverse rendering (ICLR 2026).

Conventions, everywhere in this package: the world is right-handed and Z is up; directions are unit vectors
that point away from the surface (``wo`` to the viewer, ``wi`` to the light); radiance is linear RGB;
visibility is 1 where the light is seen.
"""
