"""Gaussian surfels for inverse rendering: the parts that surfel methods share, and the contract of a method.

Rooms, from the bottom up: ``errors`` and ``plain_values``; ``instruments`` (counters and guards); ``scene`` (cameras,
views, lights, colour); ``contract`` and ``capabilities``; ``kernels`` (rasterizing, tracing, shading); ``surfels``;
``transport`` (sampling, incident light, shading, splatting); ``learning`` (losses, training views, geometry from
images). A room imports only rooms that are listed before it.

Conventions in all rooms: the world is right-handed and Z is up; directions are unit vectors that point away from the
surface (``wo`` to the viewer, ``wi`` to the light); radiance is linear RGB; visibility is 1 where the light is seen.
"""
