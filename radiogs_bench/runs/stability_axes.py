"""The conditions that get harder in suite ``stability``, and the computation under each."""

import math
from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor
from torch.nn.functional import normalize

from radiogs_core.kernels.shade.brdf import ggx_distribution
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.sampling import hemisphere_directions, tangent_frame
from radiogs_datasets.hard_scenes import FOCAL

from .stability_probes import (
    DEPTH,
    EPS,
    GEOMETRY,
    GRADIENT_TOLERANCE,
    Axis,
    Kernel,
    Probe,
    Stand,
    Values,
    drawn,
    drawn_surfels,
    looks,
    rays,
    shaded,
    traced,
)

SCATTERED = 24
SCATTERED_RAYS = 128


def scattered(count: int, generator: torch.Generator, spread: float = 1.0) -> Surfels:
    """Surfels around (0, 0, DEPTH) that face the origin within some 40 degrees."""

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator)

    # Half a turn about x takes the normal from +z to -z.
    rotation = torch.tensor([0.0, 1.0, 0.0, 0.0]) + 0.2 * normal(count, 4)
    return Surfels(
        centre=torch.tensor([0.0, 0.0, DEPTH]) + spread * 0.6 * normal(count, 3),
        rotation=normalize(rotation, dim=-1),
        log_scale=torch.log(0.2 + 0.5 * torch.rand(count, 2, generator=generator)),
        opacity_logit=normal(count),
        sh=torch.zeros(count, COEFFICIENTS, 3),
        albedo_logit=torch.zeros(count, 3),
        roughness_logit=torch.zeros(count),
    )


def moved(surfels: Surfels, camera: Camera, factor: float, shift: float) -> tuple[Surfels, Camera]:
    """World and camera scaled by ``factor`` and then moved by ``shift`` along each axis, rounded to float32."""
    parameters = surfels.parameters()
    parameters["centre"] = (surfels.centre.double() * factor + shift).float()
    parameters["log_scale"] = (surfels.log_scale.double() + torch.tensor(factor, dtype=torch.float64).log()).float()
    pose = camera.camera_to_world.double()
    pose[:3, 3] = pose[:3, 3] * factor + shift
    return Surfels.of(parameters), replace(camera, camera_to_world=pose.float())


def drawn_at(factor: float, shift: float, stand: Stand) -> Probe:
    """Rasterize the scattered surfels."""
    generator = stand.generator()
    surfels, camera = moved(scattered(SCATTERED, generator), stand.camera, factor, shift)
    return drawn_surfels(camera, surfels, looks(SCATTERED, generator)["features"], depth_unit=factor)


def traced_at(factor: float, shift: float, stand: Stand) -> Probe:
    """Trace rays from the camera's centre to the scattered surfels."""
    generator = stand.generator()
    surfels, camera = moved(scattered(SCATTERED, generator), stand.camera, factor, shift)
    geometry = surfels.geometry()
    slope = 0.6 * torch.rand(SCATTERED_RAYS, 2, generator=generator) - 0.3
    direction = normalize(torch.cat([slope, torch.ones(SCATTERED_RAYS, 1)], -1).double(), dim=-1).float()
    start = camera.centre.repeat(SCATTERED_RAYS, 1)
    fields = {name: getattr(geometry, name) for name in GEOMETRY}
    return traced(fields | looks(SCATTERED, generator) | rays(start, direction), length=factor)


RAYS = 8
NARROW = 64.0
"""Focal length relative to the scene's: a view of 0.9 degrees, which hits a stack close to its axis."""

FOOTPRINT_CONDITION = NARROW * FOCAL * math.sqrt(12)
"""Depth over the standard deviation of a pixel's footprint, under the long lens."""

OPACITY = 0.9
STEEPEST_BELL = math.exp(-0.5)
"""Largest slope of exp(-u^2 / 2)."""


def grazing_surfel(cosine: float, stand: Stand) -> Probe:
    """Parallel rays hit a surfel at distance 1.3, at the given cosine with its normal; randomly rotated.

    Along the world's axes the products would be exact, without cancellation.
    """
    generator, sine = stand.generator(), math.sqrt(1 - cosine**2)
    turn = torch.linalg.qr(torch.randn(3, 3, generator=generator).double()).Q
    start = torch.zeros(RAYS, 3, dtype=torch.float64)
    start[:, 1] = torch.linspace(-0.5, 0.5, RAYS)

    def turned(*vector: float) -> Tensor:
        return (torch.tensor([vector], dtype=torch.float64) @ turn.T).float()

    surfel = {
        "centre": turned(1.0, 0.0, -0.3 * cosine),
        "axis_u": turned(sine, 0.0, cosine),
        "axis_v": turned(0.0, 1.0, 0.0),
        "normal": turned(-cosine, 0.0, sine),
        "opacity": torch.tensor([0.8]),
    }
    beam = rays((start @ turn.T).float(), turned(1.0, 0.0, 0.0).repeat(RAYS, 1))
    return traced(surfel | looks(1, generator) | beam)


def grazing_view(cosine: float, stand: Stand) -> Probe:
    """Shade surfels towards a view at the given cosine with their normal, under light at the same cosine."""
    count, generator = 16, stand.generator()
    normal = normalize(torch.randn(count, 3, generator=generator, dtype=torch.float64), dim=-1)
    aside = normalize(torch.linalg.cross(normal, torch.randn(count, 3, generator=generator).double()), dim=-1)
    tilted = cosine * normal + math.sqrt(1 - cosine**2) * aside
    mirrored = 2 * cosine * normal - tilted
    return shaded(
        {
            "normal": normal.float(),
            "albedo": torch.rand(count, 3, generator=generator),
            "roughness": 0.3 + 0.5 * torch.rand(count, generator=generator),
            "outgoing": tilted.float()[:, None],
            "direction": torch.stack([mirrored, normal], 1).float(),
            "weight": torch.ones(count, 2),
            "visibility": torch.ones(count, 2),
            "indirect": torch.rand(count, 2, 3, generator=generator),
            "environment": stand.sky.radiance,
        }
    )


def drawn_needles(aspect: float, stand: Stand) -> Probe:
    """Rasterize needles of length 1 and the given width, seen through a long lens."""
    generator = stand.generator()
    surfels = scattered(12, generator, spread=0.004)
    surfels.log_scale = torch.tensor([1 / aspect, 1.0]).log().repeat(12, 1)
    surfels.opacity_logit = torch.full((12,), 4.0)
    return drawn_surfels(long_lens(stand.camera), surfels, looks(12, generator)["features"])


DISTANCE = 3.0


def traced_needle(aspect: float, stand: Stand) -> Probe:
    """Trace rays from the origin through the Gaussian of a needle of length 1."""
    scale, generator, count = 1 / aspect, stand.generator(), 64
    turn = torch.tensor(0.7, dtype=torch.float64)
    along = torch.stack([turn.sin(), -turn.cos(), torch.zeros_like(turn)])
    across = torch.stack([turn.cos(), turn.sin(), torch.zeros_like(turn)])
    centre = torch.tensor([0.3, -0.2, DISTANCE], dtype=torch.float64)
    u, v = (2 * torch.rand(2, count, 1, generator=generator) - 1).double()
    needle = {
        "centre": centre[None].float(),
        "axis_u": (across / scale)[None].float(),
        "axis_v": along[None].float(),
        "normal": torch.tensor([[0.0, 0.0, -1.0]]),
        "opacity": torch.tensor([OPACITY]),
    }
    towards = normalize(centre + scale * u * across + v * along, dim=-1).float()
    return traced(needle | looks(1, generator) | rays(torch.zeros(count, 3), towards))


def needle_tolerance(aspect: float) -> float:
    """Tolerance of outputs: u = (x - p)/s is off by 8 eps |p - o|/s, alpha by the bell's slope times that (case 4)."""
    return OPACITY * STEEPEST_BELL * 8 * EPS * (DISTANCE + 1) * aspect


def stack(depth: Tensor, opacity: Tensor, generator: torch.Generator) -> dict[str, Tensor]:
    """Surfels at the given depths that face the origin, and rays that hit them close to the axis."""
    count, nothing = len(depth), torch.zeros_like(depth)
    start = torch.cat([0.1 * torch.rand(RAYS, 2, generator=generator) - 0.05, torch.zeros(RAYS, 1)], -1)
    return {
        "centre": torch.stack([nothing, nothing, depth], -1),
        "axis_u": torch.tensor([[0.5, 0.0, 0.0]]).repeat(count, 1),
        "axis_v": torch.tensor([[0.0, -0.5, 0.0]]).repeat(count, 1),
        "normal": torch.tensor([[0.0, 0.0, -1.0]]).repeat(count, 1),
        "opacity": opacity,
        **looks(count, generator),
        **rays(start, torch.tensor([[0.0, 0.0, 1.0]]).repeat(RAYS, 1)),
    }


def gap(ulps: float, stand: Stand) -> dict[str, Tensor]:
    """Two surfels the given number of float32 steps apart at depth 3; the farther one has the lower index."""
    step = 2.0**-22  # of numbers from 2 to 4
    return stack(torch.tensor([3.0 + ulps * step, 3.0]), torch.tensor([0.7, 0.7]), stand.generator())


def layers(count: float, stand: Stand) -> dict[str, Tensor]:
    """``count`` surfels of opacity 0.005 to 0.01 between depths 1 and 3, above the threshold near the axis."""
    generator, number = stand.generator(), int(count)
    opacity = 0.005 * (1 + torch.rand(number, generator=generator))
    return stack(torch.linspace(1, 3, number), opacity, generator)


def long_lens(camera: Camera) -> Camera:
    """The camera with a narrow field of view about its axis."""
    return replace(camera, fx=NARROW * camera.fx, fy=NARROW * camera.fy)


LIT = 64
SPREAD, DRAWN = 16, 16
"""Directions per surfel: over its hemisphere, and drawn from the light."""


def highlight(roughness: float, stand: Stand) -> dict[str, Tensor]:
    """Surfels lit from near the mirror direction: the half-vector is up to four widths of the lobe off the normal."""
    generator = stand.generator()
    normal = normalize(torch.randn(LIT, 3, generator=generator, dtype=torch.float64), dim=-1)
    tangent, bitangent, _ = tangent_frame(normal).unbind(-1)
    width = 4 * torch.rand(LIT, 1, generator=generator).double() * roughness**2
    half = normalize(normal + width.clamp(max=0.5) * tangent, dim=-1)
    outgoing = normalize(half + torch.rand(LIT, 1, generator=generator).double() * bitangent, dim=-1)
    incoming = 2 * (outgoing * half).sum(-1, keepdim=True) * half - outgoing
    return {
        "normal": normal.float(),
        "albedo": torch.rand(LIT, 3, generator=generator),
        "roughness": torch.full((LIT,), roughness),
        "outgoing": outgoing.float()[:, None],
        "direction": incoming.float()[:, None],
        "weight": torch.ones(LIT, 1),
        "visibility": torch.ones(LIT, 1),
        "indirect": torch.rand(LIT, 1, 3, generator=generator),
        "environment": stand.sky.radiance,
    }


def lobe(roughness: float, stand: Stand) -> Probe:
    """GGX's D alone, for given half-vectors."""
    given = highlight(roughness, stand)
    half = normalize((given["outgoing"] + given["direction"])[:, 0].double(), dim=-1).float()

    def run(inputs: Values) -> tuple[Tensor, ...]:
        return (ggx_distribution(inputs["half"], inputs["normal"], inputs["roughness"]),)

    inputs = {"half": half, "normal": given["normal"], "roughness": given["roughness"]}
    return Probe(inputs, run, (1.0,), frozenset({"half"}))


def sunlit(intensity: float, stand: Stand) -> Probe:
    """Surfels under the sky with a sun in one texel, sampled by the balance heuristic over hemisphere and light."""
    generator = stand.generator()
    sky = stand.sky.radiance.clone()
    sky[len(sky) // 4, sky.shape[1] // 3] = intensity
    normal = normalize(torch.randn(LIT, 3, generator=generator), dim=-1)
    spread, _ = hemisphere_directions(normal, SPREAD, generator)
    drawn = LightSampler(EnvironmentMap(sky)).draw(LIT, DRAWN, generator)
    samples = SPREAD + DRAWN

    def weight(inputs: Values) -> Tensor:
        density = LightSampler(EnvironmentMap(inputs["environment"])).pdf(inputs["direction"])
        return 1 / (SPREAD / (2 * torch.pi) + DRAWN * density)

    return shaded(
        {
            "normal": normal,
            "albedo": torch.rand(LIT, 3, generator=generator),
            "roughness": 0.1 + 0.9 * torch.rand(LIT, generator=generator),
            "outgoing": hemisphere_directions(normal, 1, generator)[0],
            "direction": torch.cat([spread, drawn], 1),
            "visibility": torch.rand(LIT, samples, generator=generator),
            "indirect": torch.rand(LIT, samples, 3, generator=generator),
            "environment": sky,
        },
        weight,
    )


_ALL = (
    Axis(
        "grazing", "cosine of normal and ray or view", 1.0, (1e-6,),
        {
            # Case 9: two products and a quotient, amplified by the quotient.
            "trace": Kernel(grazing_surfel, lambda c: 16 * EPS / c, lambda c: max(GRADIENT_TOLERANCE, 64 * EPS / c)),
            # Case 26; a cosine of two rounded directions is itself off by 4 eps.
            "shade": Kernel(grazing_view, lambda c: 1e-4, lambda c: max(GRADIENT_TOLERANCE, 4 * EPS / c)),
        },
    ),
    Axis(
        "aspect", "aspect ratio", 1.0, (1e6,),
        {
            # Case 4: widened to a pixel, a needle's condition number is the pixel's.
            "draw": Kernel(drawn_needles, lambda a: 1e-4, lambda a: 8 * EPS * FOOTPRINT_CONDITION),
            # Four times the tolerance of values, as for grazing rays: a derivative has more such factors.
            "trace": Kernel(
                traced_needle, needle_tolerance, lambda a: max(GRADIENT_TOLERANCE, 4 * needle_tolerance(a))
            ),
        },
    ),
    Axis(
        "gap", "gap of depth in ulps", 4096.0, (1.0,),
        {
            # Case 12; the second is a sum of two hits.
            "draw": Kernel(lambda u, stand: drawn(stand.camera, gap(u, stand)), lambda u: 1e-6),
            "trace": Kernel(lambda u, stand: traced(gap(u, stand)), lambda u: 2e-6),
        },
        whole=True,
    ),
    Axis(
        "layers", "layers on a ray", 1.0, (30_000.0,),
        {
            # Case 8.
            "draw": Kernel(lambda n, stand: drawn(long_lens(stand.camera), layers(n, stand)), lambda n: 1e-5),
            "trace": Kernel(lambda n, stand: traced(layers(n, stand), stop=0.0), lambda n: 2e-5),
        },
        whole=True,
    ),
    # Cases 18 and 19: neither scale nor position matters, apart from quantisation.
    Axis(
        "scale", "scale of the scene", 1.0, (1e-6, 1e6),
        {
            "draw": Kernel(lambda factor, stand: drawn_at(factor, 0.0, stand), lambda c: 1e-4),
            "trace": Kernel(lambda factor, stand: traced_at(factor, 0.0, stand), lambda c: 1e-4),
        },
    ),
    Axis(
        "translation", "distance from the origin", 1.0, (1e6,),
        {
            "draw": Kernel(lambda shift, stand: drawn_at(1.0, shift, stand), lambda c: 1e-4),
            "trace": Kernel(lambda shift, stand: traced_at(1.0, shift, stand), lambda c: 1e-4),
        },
    ),
    Axis(
        "roughness", "roughness", 1.0, (1e-3,),
        {
            # Case 25: of the lobe's peak.
            "shade": Kernel(lambda r, stand: shaded(highlight(r, stand)), lambda r: 1e-5),
            "GGX D": Kernel(lobe, lambda r: 1e-5),
        },
    ),
    # Case 26.
    Axis("sun", "radiance of the sun", 1.0, (1e6,), {"shade": Kernel(sunlit, lambda intensity: 1e-4)}),
)  # fmt: skip

AXES: Mapping[str, Axis] = {axis.key: axis for axis in _ALL}
"""The axes by key, in the order of the suite's rows."""
