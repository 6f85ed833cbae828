"""Maps of any method are scored alike: on black, display images clipped, of the declared shape."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
import torch

from radiogs_bench.errors import MethodFailed
from radiogs_bench.scoring import rendering as module
from radiogs_core.contract import MapKind
from scenes import sphere_scene

SIZE = 2, 3
ALPHA = torch.tensor([[1.0, 0.5, 0.0], [0.25, 1.0, 0.75]])[..., None]


class Offering:
    """Declares what it offers, and renders given maps."""

    timed = True
    rendered: dict[str, torch.Tensor]

    def __init__(self, offers: Mapping[str, MapKind]) -> None:
        self.offers, self.default = offers, frozenset(offers)

    def render(self, camera: Any, *further: str) -> dict[str, torch.Tensor]:
        return self.rendered


CAMERA = replace(sphere_scene().test[0].camera, height=SIZE[0], width=SIZE[1])

STRAIGHT = Offering(
    {
        "image": MapKind("display", "straight"),
        "alpha": MapKind("data", "straight"),
        "albedo": MapKind("linear", "straight"),
        "roughness": MapKind("data", "straight"),
        "normal": MapKind("data", "straight"),
        "depth": MapKind("data", "straight"),
    }
)


def on_black(offering: Offering, rendered: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """These maps as scoring receives them."""
    offering.rendered = rendered
    return module.on_black(offering, CAMERA)


def maps(**given: float) -> dict[str, torch.Tensor]:
    """Constant maps of the right shapes, beside ALPHA."""
    one = ("roughness", "depth")
    return {"alpha": ALPHA, **{name: torch.full((*SIZE, 1 if name in one else 3), v) for name, v in given.items()}}


def test_straight_maps_except_geometry_are_multiplied_by_coverage() -> None:
    given = maps(image=0.5, albedo=0.25, roughness=0.5, normal=0.6, depth=3.0)
    found = on_black(STRAIGHT, given)
    for name in ("image", "albedo", "roughness"):
        assert torch.equal(found[name], given[name] * ALPHA), name
    for name in ("alpha", "normal", "depth"):
        assert torch.equal(found[name], given[name]), name


def test_multiplied_maps_stay_as_they_are() -> None:
    given = maps(image=0.5, albedo=2.0)
    found = on_black(
        Offering({"image": MapKind("display"), "alpha": MapKind("data"), "albedo": MapKind("linear")}), given
    )
    assert torch.equal(found["image"], given["image"])
    assert torch.equal(found["albedo"], given["albedo"])


@pytest.mark.parametrize(
    ("linear", "display"), [(0.5, 1.055 * 0.5 ** (1 / 2.4) - 0.055), (0.001, 0.01292), (7.0, 1.0), (-1.0, 0.0)]
)
def test_a_linear_image_is_encoded_and_clipped(linear: float, display: float) -> None:
    offering = Offering({"image": MapKind("linear"), "indirect": MapKind("linear")})
    found = on_black(offering, {name: torch.full((*SIZE, 3), linear) for name in offering.offers})
    torch.testing.assert_close(found["image"], torch.full((*SIZE, 3), display))
    assert torch.equal(found["indirect"], torch.full((*SIZE, 3), linear)), "radiance stays linear"


def test_coverage_is_of_light_and_not_of_its_encoding() -> None:
    """Half covered, a straight linear image has half the radiance."""
    offering = Offering({"image": MapKind("linear", "straight"), "alpha": MapKind("data")})
    found = on_black(offering, {"image": torch.full((*SIZE, 3), 0.5), "alpha": torch.full((*SIZE, 1), 0.5)})
    torch.testing.assert_close(found["image"], torch.full((*SIZE, 3), 1.055 * 0.25 ** (1 / 2.4) - 0.055))


def test_a_display_image_beyond_its_range_is_clipped() -> None:
    offering = Offering({"image": MapKind("display")})
    assert torch.equal(on_black(offering, {"image": torch.full((*SIZE, 3), 1.5)})["image"], torch.ones(*SIZE, 3))


def test_straight_maps_without_coverage_stay_as_they_are() -> None:
    found = on_black(Offering({"image": MapKind("display", "straight")}), {"image": torch.full((*SIZE, 3), 0.5)})
    assert "alpha" not in found
    assert torch.equal(found["image"], torch.full((*SIZE, 3), 0.5))


@pytest.mark.parametrize(
    ("name", "shape", "why"),
    [
        ("gloss", (*SIZE, 3), "`offers` of what it prepared names: image, alpha"),
        ("roughness", (*SIZE, 3), r"\(2, 3, 1\)"),
        ("albedo", (*SIZE, 1), r"\(2, 3, 3\)"),
        ("albedo", (3, *SIZE), r"\(2, 3, 3\)"),
        ("depth", SIZE, r"\(2, 3, 1\)"),
        ("normal", (4, 6, 3), r"\(2, 3, 3\)"),
    ],
)
def test_a_map_that_was_not_declared_or_is_misshapen_is_refused_by_its_name(
    name: str, shape: tuple[int, ...], why: str
) -> None:
    with pytest.raises(MethodFailed, match=f"map '{name}'") as no:
        on_black(STRAIGHT, {"image": torch.zeros(*SIZE, 3), "alpha": ALPHA, name: torch.zeros(shape)})
    with pytest.raises(AssertionError, match=why):
        raise AssertionError(no.value.why)
