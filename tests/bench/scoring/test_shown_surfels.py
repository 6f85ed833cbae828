"""The surfels that are kept with a result are those of the model, in the units that the report draws."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from radiogs_bench.initial_viewpoint import InitialViewpoint
from radiogs_bench.scoring import report_arrays
from radiogs_bench.scoring.report_arrays import surfel_arrays
from radiogs_core.surfels.surfels import Surfels

COUNT = 5
SEEN_FROM = InitialViewpoint(torch.tensor([3.0, 1.0, 2.0]), torch.tensor([0.0, 0.0, 1.0]))


class Bare:
    """A trained model that is made of something else."""

    light = None

    def facts(self) -> dict[str, Any]:
        return {}

    def export(self, folder: Path) -> list[Path]:
        return []

    def prepare(self, light: Any = None, albedo_scale: Any = None, after_step: Any = None) -> Any:
        raise AssertionError("it is not rendered here")


@dataclass
class Model(Bare):
    surfels: Surfels


@pytest.fixture
def surfels() -> Surfels:
    generator = torch.Generator().manual_seed(4)

    def random(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    return Surfels(
        centre=random(COUNT, 3),
        rotation=random(COUNT, 4),
        log_scale=random(COUNT, 2) - 2,
        opacity_logit=random(COUNT),
        sh=0.2 * random(COUNT, 16, 3),
        albedo_logit=random(COUNT, 3),
        roughness_logit=random(COUNT),
    )


def test_arrays_hold_what_the_raw_parameters_mean(surfels: Surfels) -> None:
    arrays = surfel_arrays(Model(surfels), SEEN_FROM)
    order = (surfels.opacity * surfels.scale.prod(-1)).argsort(descending=True)
    assert (arrays["surfels/centre"] == surfels.centre[order].numpy()).all()
    u, v = torch.from_numpy(arrays["surfels/tangents"]).unbind(1)
    assert torch.stack([u.norm(dim=-1), v.norm(dim=-1)], -1).allclose(surfels.scale[order])
    normal = torch.linalg.cross(u, v)
    assert (normal / normal.norm(dim=-1, keepdim=True)).allclose(surfels.frame[order][..., 2], atol=1e-6)
    constant = 0.28209479177387814 * surfels.sh[order, 0] + 0.5  # mean over all directions
    wanted = {
        "radiance": constant.clamp(min=0),
        "opacity": torch.sigmoid(surfels.opacity_logit[order]),
        "albedo": torch.sigmoid(surfels.albedo_logit[order]),
        "roughness": 0.05 + 0.95 * torch.sigmoid(surfels.roughness_logit[order]),
    }
    for name, values in wanted.items():
        assert arrays[f"surfels/{name}"] == pytest.approx(values.numpy(), abs=1e-3), name
    assert arrays["surfels/count"].tolist() == [COUNT]


def test_the_surfels_with_the_most_coverage_are_kept_of_a_large_model(
    surfels: Surfels, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report_arrays, "MOST_SURFELS", 2)
    faint = replace(surfels, log_scale=torch.zeros(COUNT, 2), opacity_logit=torch.tensor([0.0, -9.0, 3.0, -9.0, 1.0]))
    arrays = surfel_arrays(Model(faint), SEEN_FROM)
    assert (arrays["surfels/centre"] == surfels.centre[[2, 4]].numpy()).all()
    assert arrays["surfels/count"].tolist() == [COUNT]


def test_radiance_beyond_half_precision_is_the_largest_number_of_it(surfels: Surfels) -> None:
    arrays = surfel_arrays(Model(replace(surfels, sh=surfels.sh + 1e6)), SEEN_FROM)
    assert np.isfinite(arrays["surfels/radiance"]).all()
    assert arrays["surfels/radiance"].min() == 65504


def test_models_without_surfels_have_no_arrays(surfels: Surfels) -> None:
    empty = Surfels.of({name: value[:0] for name, value in surfels.plain().items()})
    assert surfel_arrays(Model(empty), SEEN_FROM) == {}
    assert surfel_arrays(Bare(), SEEN_FROM) == {}


def test_the_initial_viewpoint_is_kept(surfels: Surfels) -> None:
    arrays = surfel_arrays(Model(surfels), SEEN_FROM)
    assert arrays["surfels/eye"].tolist() == [3.0, 1.0, 2.0]
    assert arrays["surfels/up"].tolist() == [0.0, 0.0, 1.0]
    assert "surfels/middle" not in arrays
    arrays = surfel_arrays(Model(surfels), replace(SEEN_FROM, middle=torch.tensor([1.0, 0.0, 0.5])))
    assert arrays["surfels/middle"].tolist() == [1.0, 0.0, 0.5]
