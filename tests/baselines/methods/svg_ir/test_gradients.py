"""SVG-IR's consistency loss in float64 against a dense reference of the formulas and central differences."""

from dataclasses import replace
from functools import cache

import torch
from torch import Tensor

from baselines.methods.dense import F64, assert_same_gradients, gradients
from baselines.methods.irgs.world import DOWN, grey, sheet, together
from baselines.methods.svg_ir.world import DISTANCE, model_of, walk
from radiogs_baselines.methods.svg_ir.model import Model
from radiogs_baselines.methods.svg_ir.shading import mirrored
from radiogs_baselines.methods.svg_ir.table import Table, table_of
from radiogs_baselines.methods.svg_ir.training import radiance_consistency
from radiogs_core.surfels.surfels import Surfels
from reference.differences import Values, assert_gradients
from reference.shade import shade

EYE = torch.tensor([0.6, 0.2, 1.0], dtype=F64)
LEARNT = ("vertex_albedo_logit", "vertex_roughness_logit", "log_environment", "ratio")


@cache
def fixed() -> tuple[Surfels, Table]:
    """Two pieces of a floor under two sheets, each smaller than a hop."""
    surfels = together(
        sheet(0.0, scale=0.05, dtype=F64),
        sheet(0.01, (0.1, 0.0, 0.995), scale=0.05, dtype=F64),
        sheet(0.06, DOWN, scale=0.04, opacity=0.7, radiance=0.4, dtype=F64),
        sheet(0.1, DOWN, scale=0.06, opacity=0.9, radiance=0.9, dtype=F64),
    )
    surfels.centre = surfels.centre + torch.tensor([[0, 0, 0], [0.05, 0, 0], [0.01, 0, 0], [0, 0.02, 0]], dtype=F64)
    return surfels, table_of(surfels, walk(), 24, 0)


@cache
def start() -> Values:
    torch.manual_seed(5)
    model = model_of(fixed()[0], grey())
    noisy = {name: getattr(model, name) + 0.3 * torch.randn_like(getattr(model, name)) for name in LEARNT[:2]}
    return noisy | {"log_environment": 0.3 * torch.randn(6, 12, 3, dtype=F64), "ratio": torch.tensor(1.3, dtype=F64)}


def model(values: Values) -> Model:
    return replace(model_of(fixed()[0], grey()), **values)


def loss(values: Values) -> Tensor:
    surfels, table = fixed()
    found = model(values)
    return radiance_consistency(found, table, torch.arange(len(surfels)), EYE, found.environment, DISTANCE)


def differences(values: Values) -> Tensor:
    """One-bounce radiance minus the table's radiance times the ratio, ray by ray, from the formulas."""
    surfels, table = fixed()
    found, apart = model(values), []
    for surfel, sample in zip(*mirrored(table, surfels, torch.arange(len(surfels)), EYE), strict=True):
        hit, (u, v) = int(table.hit_surfel[surfel, sample]), table.hit_uv[surfel, sample]
        right, up = (max(0.0, min(1.0, float(each) / (2 * DISTANCE) + 0.5)) for each in (u, v))
        share = torch.tensor([(1 - right) * (1 - up), right * (1 - up), (1 - right) * up, right * up], dtype=F64)
        parts = shade(
            surfels.frame[hit, :, 2][None], (share @ found.albedo[hit])[None], (share @ found.roughness[hit])[None],
            -table.direction[surfel, sample][None, None], table.direction[hit][None], table.weight[hit][None],
            table.visibility[hit][None], torch.zeros(1, 24, 3, dtype=F64), found.environment,
        )  # fmt: skip
        apart.append(parts.sum(2)[0, 0] - found.ratio * table.radiance[surfel, sample])
    return torch.stack(apart)


def test_consistency_and_its_gradients_equal_the_formulas() -> None:
    def dense(values: Values) -> Tensor:
        return differences(values).abs().sum() / (3 * len(fixed()[0]))

    assert 0 < len(differences(start())) < len(fixed()[0]), "some have a ray and some none"
    torch.testing.assert_close(loss(start()), dense(start()), rtol=1e-10, atol=0)
    assert_same_gradients(gradients(loss, start(), LEARNT), gradients(dense, start(), LEARNT), LEARNT)


def test_gradients_of_consistency_equal_central_differences() -> None:
    def signs(values: Values) -> object:
        return (differences(values) > 0).flatten().tolist()

    found = gradients(loss, start(), LEARNT)
    assert_gradients(lambda values: float(loss(values)), start(), found, 1e-3, signs, directions=3)


def test_the_radiance_of_the_table_and_normals_have_no_gradient() -> None:
    surfels, table = fixed()
    sh = surfels.sh.clone().requires_grad_()
    bright = Surfels.of(surfels.parameters() | {"sh": sh})
    assert not table_of(bright, walk(), 4, 0).radiance.requires_grad
    offset = torch.zeros(len(surfels), 4, 3, dtype=F64, requires_grad=True)
    found = replace(model(start()), vertex_offset=offset, ratio=torch.tensor(1.0, dtype=F64, requires_grad=True))
    radiance_consistency(found, table, torch.arange(len(surfels)), EYE, found.environment, DISTANCE).backward()
    assert offset.grad is None or not offset.grad.any()
