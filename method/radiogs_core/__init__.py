"""Gaussian surfels for inverse rendering: what every surfel method is built from, and what a method is.

Rooms, from the bottom up: ``errors`` and ``plain``; ``instruments`` (counters and guards); ``scene`` (cameras, views,
lights, colour); ``kernels`` (rasterizing, tracing, shading); ``surfels``; ``transport`` (sampling, incident light,
shading, splatting); ``learning`` (losses, training views, geometry from images). A room imports those before it and
none after it.

Conventions, everywhere: the world is right-handed and Z is up; directions are unit vectors that point away from the
surface (``wo`` to the viewer, ``wi`` to the light); radiance is linear RGB; visibility is 1 where the light is seen.
"""
