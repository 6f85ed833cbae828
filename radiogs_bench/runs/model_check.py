"""Whether a trained model shows what its contract says: the second half of ``methods check``."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor

from radiogs_core.contract import Method, NotOffered, Prepared, Run, Trained
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import View

from ..method_calls import calling, require
from ..own_values import own_camera, own_light
from ..scoring.maps import on_black
from .stages import facts_of

UNIT = 1e-2
"""Largest error of the length of a normal."""

CLEARLY = 3.0
"""Decibels by which another colour space has to fit better before it is named."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    verdict: Literal["holds", "fails", "note"]
    what: str
    """The observation, in one sentence."""
    remedy: str = ""
    """The next thing to do; empty where nothing is wrong."""


def check_model(
    method: Method, run: Run, product: Mapping[str, Any], stored: Mapping[str, Any], folder: Path
) -> Iterator[Finding]:
    """Findings about the views of a trained model, under its own light and another one."""
    model, view = _restored(method, run, product), run.scene.test[0]
    facts_of(method.name, model)
    yield Finding("holds", "facts() are plain values")
    shown = _prepared(method, model)
    maps = _maps(method, shown, view)
    yield Finding("holds", f"maps have the declared names, the camera's size and numbers: {', '.join(maps)}")
    yield from _ranges(method, shown, run.scene.test[0])
    if "image" not in maps:
        yield Finding("fails", "there is no map 'image'", "It is what every metric of new views compares.")
        return
    yield _colour_space(maps["image"], shown, view)
    for other in run.scene.test[1:2]:
        _maps(method, shown, other)
    yield _repeated(difference(maps, _maps(method, shown, view)), "a view rendered again, after another view")
    again = _maps(method, _prepared(method, _restored(method, run, stored)), view)
    yield _repeated(difference(maps, again), "the model that restore() makes a second time")
    yield from _relit(method, run, model, maps)
    yield _repeated(difference(maps, _maps(method, _prepared(method, model), view)), "a view after relighting")
    yield _exported(method, model, folder)


def _restored(method: Method, run: Run, product: Mapping[str, Any]) -> Trained:
    with calling(method.name, "restore()"):
        model = method.restore(run, product)
    require(method.name, model, Trained, "restore()")
    return model


def _prepared(method: Method, model: Trained, *lit: Any) -> Prepared:
    with calling(method.name, "prepare()"):
        shown = model.prepare(*lit)
    require(method.name, shown, Prepared, "prepare()")
    return shown


def _maps(method: Method, shown: Prepared, view: View) -> dict[str, Tensor]:
    return on_black(shown, view.camera, method=method.name, view=view.name)


def _ranges(method: Method, shown: Prepared, view: View) -> Iterator[Finding]:
    """Whether values, as rendered, lie where the contract has them."""
    with calling(method.name, "render()"):
        maps = {name: image.detach().cpu() for name, image in shown.render(own_camera(view.camera)).items()}
    wrong = []
    for name, image in maps.items():
        finite = image[image.isfinite()]
        low, high = (float(finite.min()), float(finite.max())) if finite.numel() else (0.0, 0.0)
        top = 1.0 if name in ("image", "alpha", "roughness") else float("inf")
        if name != "normal" and (low < -1e-6 or high > top + 1e-6) and not _is_linear_image(name, shown):
            wrong.append(f"{name} from {low:.3g} to {high:.3g}")
    if "normal" in maps:
        covered = maps["alpha"][..., 0] > 0.5 if "alpha" in maps else maps["normal"].abs().sum(-1) > 0
        error = (maps["normal"].norm(dim=-1) - 1).abs()[covered]
        if error.numel() and float(error.max()) > UNIT:
            wrong.append(f"normals of length {float(maps['normal'].norm(dim=-1)[covered].min()):.3g} and more")
    if wrong:
        yield Finding(
            "fails",
            f"values outside of their range: {'; '.join(wrong)}",
            "image, alpha and roughness lie in [0, 1], albedo, depth and radiance are not negative, normals are unit.",
        )
    else:
        yield Finding("holds", "values lie in their ranges")


def _is_linear_image(name: str, shown: Prepared) -> bool:
    return name == "image" and shown.offers[name].colour == "linear"


def _colour_space(image: Tensor, shown: Prepared, view: View) -> Finding:
    """Whether the image fits the true one better if its declared colour space is exchanged."""
    truth = view.read("image")
    if view.has("alpha"):
        truth = truth * view.read("alpha")
    other, name = (
        (srgb_encode(image), "linear") if shown.offers["image"].colour == "display" else (srgb_decode(image), "display")
    )
    declared, exchanged = (
        -10 * float((each.double() - truth).square().mean().clamp(min=1e-12).log10()) for each in (image, other)
    )
    if exchanged > declared + CLEARLY:
        return Finding(
            "fails",
            f"the image fits the true one by {exchanged - declared:.1f} dB better if its colours are taken for {name}",
            f'Declare it MapKind("{name}") in `offers`, or render what is declared.',
        )
    return Finding(
        "holds", f"the image's colour space is the declared one ({declared:.1f} dB; the other: {exchanged:.1f})"
    )


def _repeated(where: str, what: str) -> Finding:
    if where:
        return Finding(
            "fails",
            f"{what} differs: map{where}",
            "render() and prepare() may not change the model, nor draw unseeded numbers.",
        )
    return Finding("holds", f"{what} has the same bits")


def _relit(method: Method, run: Run, model: Trained, maps: Mapping[str, Tensor]) -> Iterator[Finding]:
    """Relighting: refused in words, or another image, whose brightness follows ``albedo_scale``."""
    view = run.scene.test[0]
    light = EnvironmentMap(torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(0)))
    images = []
    for factor in (1.0, 0.5):
        try:
            lit = _prepared(method, model, own_light(light), torch.full((3,), factor))
        except NotOffered as refusal:
            yield Finding("note", f"relighting is not offered: {refusal.what}")
            return
        relit = _maps(method, lit, view)
        if "image" not in relit:
            yield Finding("fails", "a relit view has no map 'image'", "It is what every metric of relighting compares.")
            return
        images.append(relit["image"])
    if not _shows_something(maps):
        yield Finding("note", "the model shows nothing yet: relighting cannot be told", "Check at a larger --preset.")
    elif not images[0].any():
        yield Finding("fails", "a view under another light is black", "prepare(light) has to use its light.")
    elif torch.equal(images[0], maps["image"]):
        yield Finding(
            "fails", "a view under another light is the view under its own", "prepare(light) has to use its light."
        )
    elif torch.equal(*images):
        yield Finding(
            "fails",
            "relit views do not depend on albedo_scale",
            "Multiply the recovered albedo by albedo_scale before it is lit.",
        )
    else:
        yield Finding("holds", "another light and a factor of the albedo change the image")


def _shows_something(maps: Mapping[str, Tensor]) -> bool:
    covered = "alpha" not in maps or float(maps["alpha"].max()) > 0.5
    return covered and bool(maps["image"].any())


def _exported(method: Method, model: Trained, folder: Path) -> Finding:
    place = folder / "export"
    place.mkdir(parents=True, exist_ok=True)
    with calling(method.name, "export()"):
        files = list(model.export(place))
    if absent := [str(file) for file in files if not Path(file).is_file()]:
        return Finding(
            "fails",
            f"export() names files that are not there: {', '.join(absent)}",
            "Return the paths of the files that it wrote.",
        )
    return Finding("holds", f"export() writes the {len(files)} files that it names")


def difference(one: Any, other: Any) -> str:
    """The place of the first difference of two structures of tensors and plain values; empty if there is none."""
    if isinstance(one, Tensor) and isinstance(other, Tensor):
        alike = one.shape == other.shape and one.dtype == other.dtype
        return "" if alike and bool(((one == other) | ((one != one) & (other != other))).all()) else " "
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        if one.keys() != other.keys():
            return " "
        return next(
            (f"[{name!r}]{found}".rstrip() for name in one if (found := difference(one[name], other[name]))), ""
        )
    if isinstance(one, list | tuple) and isinstance(other, list | tuple) and len(one) == len(other):
        pairs = enumerate(zip(one, other, strict=True))
        return next((f"[{number}]{found}".rstrip() for number, pair in pairs if (found := difference(*pair))), "")
    return "" if one == other or (one != one and other != other) else " "
