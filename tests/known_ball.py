"""A matte ball in white light whose surfels are known, and both stages begun with surfels of one's own choice."""

from dataclasses import replace
from functools import cache
from typing import Any

import torch

from radiogs.initialise import Initialisation
from radiogs.invert import InverseRendering
from radiogs.method import RADIOGS
from radiogs.settings import PRESETS, Budget, Variant
from radiogs_core.contract import Run
from radiogs_core.kernels.surfel.footprint import frames
from radiogs_core.plain_values import with_values
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.scene import Scene, View
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Sphere
from scenes import sphere_scene, surfels_over

CPU = torch.device("cpu")
COLOUR = (0.1, 0.25, 0.15)
"""Linear radiance of the ball towards all sides."""

LOBE = 0.03
"""About what a rough surface's lobe sends out under a light of 1, besides its albedo."""

WHITE = torch.zeros(8, 16, 3)
"""Log-radiance of the light that the ball is in: 1 from everywhere."""


def _painted(view: View) -> View:
    alpha = view.read("alpha")
    image = srgb_encode(torch.tensor(COLOUR)) * alpha
    return View(view.name, view.camera, {"image": lambda: image, "alpha": lambda: alpha})


def ball_scene(views: int = 3, size: int = 24) -> Scene:
    """The unit ball, white light of 1, on images of ``size`` pixels."""
    scene = sphere_scene(views, size)
    return replace(scene, train=tuple(map(_painted, scene.train)), test=tuple(map(_painted, scene.test)))


def ball() -> Surfels:
    """Surfels on the ball with its materials and, of degree 0 alone, its radiance."""
    albedo = tuple(value - LOBE for value in COLOUR)
    surfels = surfels_over([Sphere((0.0, 0.0, 0.0), 1.0, Material(albedo, 0.9))], 0.18)
    surfels.sh[:, 0] = radiance_to_sh(torch.tensor([COLOUR]))
    return surfels


SCENE = ball_scene()
BALL = ball()
BUDGET = with_values(
    PRESETS["smoke"],
    {
        "geometry.steps": 1000,
        "inverse_iterations": 1000,
        "geometry.initial_surfels": len(BALL),
        "light_height": 8,
        "consistency_surfels": len(BALL),
        "geometry.densify_interval": 1000,
        "refresh_interval": 1000,
    },
)


def changed(**parameters: torch.Tensor) -> Surfels:
    """The ball with some raw parameters replaced."""
    return Surfels.of(BALL.parameters() | parameters)


def noise(like: torch.Tensor, size: float) -> torch.Tensor:
    return size * torch.randn(like.shape, generator=torch.Generator().manual_seed(7))


def tilted(degrees: float) -> Surfels:
    """The ball with every surfel turned about its own tangent, to one side or the other."""
    sign = noise(BALL.opacity_logit, 1.0).sign()
    half = torch.deg2rad(degrees * sign / 2)
    w, x, y, z = BALL.rotation.unbind(-1)
    # Quaternion product with (cos, sin, 0, 0): a rotation about t_u.
    turned = torch.stack(
        [w * half.cos() - x * half.sin(), x * half.cos() + w * half.sin(),
         y * half.cos() + z * half.sin(), z * half.cos() - y * half.sin()], -1,
    )  # fmt: skip
    cosine = (frames(turned)[..., 2] * BALL.frame[..., 2]).sum(-1)
    torch.testing.assert_close(cosine, torch.deg2rad(torch.tensor(degrees)).cos().expand(len(BALL)))
    return changed(rotation=turned)


@cache
def _begun(variant: Variant, budget: Budget) -> Initialisation:
    """Most of a test's time would go into starting points that are replaced at once; of the hull, so that they may move
    from the first step on."""
    start = replace(variant.geometry.start, points="hull")
    return Initialisation(Run(SCENE, replace(variant, geometry=replace(variant.geometry, start=start)), budget, 0, CPU))


def _placed(stage: Any, tensors: dict[str, torch.Tensor], share: float) -> Any:
    """The stage with these tensors, at that share of its iterations and without moments."""
    state = stage.state()
    before = state["optimiser"]
    state["optimiser"] = before | {"tensors": before["tensors"] | tensors, "moments": {}}
    state["iteration"] = round(share * stage.iterations)
    stage.restore(state)
    return stage


def _tensors(surfels: Surfels, light: torch.Tensor) -> dict[str, torch.Tensor]:
    own = surfels.parameters() | {"log_environment": light}
    return own | {"sh": surfels.sh[:, :1], "sh_rest": surfels.sh[:, 1:]}


def initialisation(
    surfels: Surfels, share: float, variant: Variant | None = None, light: torch.Tensor = WHITE, budget: Budget = BUDGET
) -> Initialisation:
    """Stage 1 as if it had come as far as ``share`` and had learnt these surfels and this log-radiance of the light."""
    return _placed(_begun(variant or Variant(), budget), _tensors(surfels, light), share)


def inverse_rendering(
    surfels: Surfels, share: float, variant: Variant | None = None, light: torch.Tensor = WHITE, budget: Budget = BUDGET
) -> InverseRendering:
    """Stage 2 in the same way; it began with these surfels."""
    variant = variant or Variant()
    product = initialisation(surfels, 1.0, variant, light).product()
    stage = RADIOGS.stages(variant, budget)[1].begin(Run(SCENE, variant, budget, 0, CPU), product)
    assert isinstance(stage, InverseRendering)
    return _placed(stage, _tensors(surfels, light), share)
