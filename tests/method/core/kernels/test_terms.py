"""K17, all image losses of a step in one function, against dense float64 operations and their gradients."""

from collections.abc import Sequence
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from radiogs_core.kernels.image.blocks import COLUMNS
from radiogs_core.kernels.image.terms import Aim, Blended, Compared, Terms, image_terms
from radiogs_core.scene.camera import Camera
from reference import images as dense

in_every_arrangement = pytest.mark.usefixtures("arrangement")

SIZES = [(1, 1), (1, 7), (2, 2), (13, 11), (5, COLUMNS + 3)]


def smoothness(*weights: float) -> tuple[tuple[str, float], ...]:
    return tuple(zip(("smooth normal", "smooth albedo", "smooth roughness"), weights, strict=True))


FULL = Terms(
    images=(Compared("own", 0.8, 0.2), Compared("shaded", 0.3, 0.6, attached=False, squared=4.0)),
    encoding="straight", background=0.7, mask=0.05, normal=0.1, one_sided=True, distortion=0.4, far=2.5,
    smoothness=smoothness(0.05, 0.2, 0.3), masked=True,
)  # fmt: skip

CASES = {
    "everything": FULL,
    "one image, premultiplied, nothing masked": replace(
        FULL, images=(Compared("own", 1.0, 0.0),), encoding="premultiplied", masked=False, far=0.0
    ),
    "central differences": replace(FULL, one_sided=False, smoothness=smoothness(0.0, 0.2, 0.0), background=0.0),
    "normals of the depth map, and a squared error": replace(
        FULL,
        images=(Compared("own", 0.0, 0.0), Compared("shaded", 0.0, 0.0, squared=3.0)),
        mask=0.0,
        distortion=0.0,
        smoothness=smoothness(0.0, 0.0, 0.0),
    ),
    "display colour, without normals of the depth map": replace(
        FULL, encoding="display", normal=0.0, smoothness=smoothness(0.5, 0.0, 0.0), masked=False
    ),
    "no smoothness": replace(FULL, smoothness=()),
    "coverage and distortion": replace(FULL, images=(), normal=0.0, smoothness=smoothness(0.0, 0.0, 0.0)),
}


def camera_of(height: int, width: int) -> Camera:
    turn = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64)).Q
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3], pose[:3, 3] = turn * turn.det(), torch.tensor([1.0, -2.0, 0.5])
    return Camera(pose, 11.0, 13.0, 0.4 * width, 0.7 * height, width, height)


def given(height: int, width: int, images: int) -> tuple[Aim, list[Tensor]]:
    """The aim, and coverage, normal, depth, distortion, images, albedo and roughness."""

    def random(*channels: int, most: float = 1.0) -> Tensor:
        return most * torch.rand(height, width, *channels, dtype=torch.float64)

    alpha = random()
    alpha = torch.where(random() < 0.7, 0.5 + 0.5 * alpha, 0.5 * alpha)
    alpha[0, 0] = 0 if height > 1 else 1
    target, mask = random(3, most=1.2).clamp(max=1), random(most=2).clamp(max=1)
    pictures = [random(3, most=1.5) * alpha[..., None] for _ in range(images)]
    allowance = torch.rand(2, height, width, 3, dtype=torch.float64)
    normal = torch.nn.functional.normalize(random(3) - 0.5, dim=-1) * alpha[..., None]
    depth = torch.where(alpha > 0, 2 + random(), 0.0)
    return Aim(target, mask, allowance), [alpha, normal, depth, random(), *pictures, random(3), random(1)]


def expected(terms: Terms, camera: Camera, aim: Aim, tensors: Sequence[Tensor]) -> dict[str, Tensor]:
    """The losses one by one; those without weight are zero."""
    count = len(terms.images)
    alpha, normal, depth, distortion, *others = tensors
    pictures, maps = others[:count], [normal, *others[count:]]
    found = {}
    for each, picture in zip(terms.images, pictures, strict=True):
        covered = alpha if each.attached else alpha.detach()
        if terms.encoding == "display":
            shown = picture + terms.background * (1 - covered)[..., None]
        else:
            shown = dense.displayed(picture[None], covered, terms.encoding == "straight", terms.background)[0]
        distance, alike, square = dense.compared(shown[None], aim.image)[0]
        found[each.name] = each.absolute * distance + each.similarity * (1 - alike) + each.squared * square
    sure = alpha.clamp(1e-6, 1 - 1e-6)
    found["mask"] = -terms.mask * (aim.mask * sure.log() + (1 - aim.mask) * (1 - sure).log()).mean()
    points, solid = camera.centre + camera.ray_directions() * depth[..., None], alpha >= 0.5
    normals = dense.one_sided_normals if terms.one_sided else dense.central_normals
    target = normals(points, torch.where(solid, depth, 1.0), solid, camera.centre)
    known = target.square().sum(-1) > 0
    found["normal"] = terms.normal * (torch.where(known, alpha, 0.0) - (normal * target).sum(-1)).mean()
    beyond = (depth.detach() / terms.far).clamp(min=1) if terms.far else torch.ones_like(depth)
    found["distortion"] = terms.distortion * (distortion / beyond**4).mean()
    assert aim.allowance is not None
    for (name, weight), data in zip(terms.smoothness, maps, strict=bool(terms.smoothness)):
        masked = aim.mask[..., None] * data if terms.masked else data
        found[name] = weight * dense.edge_aware_smoothness(masked, aim.allowance)
    return found


def weights_of(terms: Terms) -> dict[str, float]:
    images = {each.name: each.absolute + each.similarity + each.squared for each in terms.images}
    return images | {name: getattr(terms, name) for name in ("mask", "normal", "distortion")} | dict(terms.smoothness)


def ours(terms: Terms, camera: Camera, aim: Aim, tensors: Sequence[Tensor]) -> dict[str, Tensor]:
    split = 4 + len(terms.images)
    return image_terms(terms, camera, aim, Blended(*tensors[:4]), tensors[4:split], tensors[split:])


@in_every_arrangement
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize(("height", "width"), SIZES)
def test_all_terms_and_gradients_agree_with_dense_operations(name: str, height: int, width: int) -> None:
    terms, camera = CASES[name], camera_of(height, width)
    aim, tensors = given(height, width, len(terms.images))
    tensors = tensors if terms.smoothness else tensors[:-2]
    mine, other = ([each.clone().requires_grad_() for each in tensors] for _ in range(2))
    found, wanted = ours(terms, camera, aim, mine), expected(terms, camera, aim, other)
    assert found.keys() == {name for name, weight in weights_of(terms).items() if weight}
    pull = dict(zip(wanted, torch.randn(len(wanted), dtype=torch.float64), strict=True))
    for key, loss in found.items():
        torch.testing.assert_close(loss, wanted[key], rtol=1e-9, atol=1e-12)
    torch.stack([pull[key] * loss for key, loss in found.items()]).sum().backward()
    torch.stack([pull[key] * loss for key, loss in wanted.items()]).sum().backward()
    for place, (one, two) in enumerate(zip(mine, other, strict=True)):
        zero = torch.zeros_like(one)
        torch.testing.assert_close(
            zero if one.grad is None else one.grad, zero if two.grad is None else two.grad,
            rtol=1e-8, atol=1e-12, msg=lambda text, place=place: f"gradient {place}: {text}",
        )  # fmt: skip
