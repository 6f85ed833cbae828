"""Output folders as public codes write them, made from a scene's own ground truth with some noise.

Written from the layouts' descriptions, by other means than the readers: each writer places its files itself.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets.image_files import write_exr, write_png

Maps = dict[str, Tensor]


def noisy(scene: Scene) -> dict[str, Maps]:
    """By view: maps on black, 8-bit levels where a file will be 8 bit; ``relit/<light>`` among them."""
    generator = torch.Generator().manual_seed(0)
    found = {}
    for view in scene.test:
        alpha = view.read("alpha")
        # Edges that are covered in part are encoded in as many ways as there are codes: solid pixels alone are noisy.
        solid = (alpha == 1).float()

        def disturbed(name: str, view: View = view, solid: Tensor = solid) -> Tensor:
            image = view.read(name)
            noise = 0.05 * torch.randn(image.shape, generator=generator)
            return ((image + noise).clamp(0, 1) * solid * 255).round() / 255

        maps = {name: disturbed(name) for name in ("image", "albedo", "roughness")}
        normal = torch.nn.functional.normalize(
            view.read("normal") + 0.1 * torch.randn((*alpha.shape[:2], 3), generator=generator), dim=-1
        )
        maps["normal"] = (normal + 1) / 2
        maps["indirect"] = (srgb_encode(view.read("indirect")).clamp(0, 1) * 255).round() / 255
        maps["alpha"] = alpha
        for light in scene.lights:
            if view.has(f"relit/{light}"):
                maps[f"relit/{light}"] = disturbed(f"relit/{light}")
        found[view.name] = maps
    return found


def png(path: Path, image: Tensor) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_png(path, image.numpy())


def on_white(image: Tensor, alpha: Tensor) -> Tensor:
    return image + (1 - alpha)


def relit(maps: Maps) -> dict[str, Tensor]:
    return {name.removeprefix("relit/"): image for name, image in maps.items() if name.startswith("relit/")}


def image_stem(view: str) -> str:
    """The name that R3DG and SVG-IR give a view: the last part of its image's path, without the suffix."""
    return "rgba" if view.startswith("test_") else view.rsplit("/", 1)[-1] + "_rgba"


def write_radiogs(folder: Path, predicted: dict[str, Maps]) -> None:
    write_irgs(folder, predicted)
    for index, maps in enumerate(predicted.values()):
        png(folder / f"test/ours_20000/light_indirect/{index:05d}.png", 0.5 * maps["indirect"])
        png(folder / f"test/ours_20000/render_indirect/{index:05d}.png", maps["indirect"])


def write_irgs(folder: Path, predicted: dict[str, Maps]) -> None:
    base = folder / "test" / "ours_20000"
    for index, maps in enumerate(predicted.values()):
        png(base / f"render/{index:05d}.png", maps["image"])
        png(base / f"rend_alpha/{index:05d}.png", maps["alpha"])
        png(base / f"base_color_linear/{index:05d}.png", maps["albedo"])
        png(base / f"roughness/{index:05d}.png", maps["roughness"].expand(-1, -1, 3))
        png(base / f"rend_normal/{index:05d}.png", maps["normal"])
        for light, image in relit(maps).items():
            png(folder / f"test_rli_light/envmap_{light}/render/{index}.png", image)


def write_gs_ir(folder: Path, predicted: dict[str, Maps]) -> None:
    base = folder / "test" / "ours_None"
    for index, maps in enumerate(predicted.values()):
        metal = torch.zeros_like(maps["albedo"])
        rough = maps["roughness"].expand(-1, -1, 3)
        png(base / f"pbr/{index:05d}.png", maps["image"])
        png(base / f"pbr/{index:05d}_brdf.png", torch.cat([maps["albedo"], rough, metal], 1))
        png(base / f"normal/{index:05d}_normal.png", maps["normal"])
        for light, image in relit(maps).items():
            png(base / f"relight/{index:05d}_{light}.png", image)


def write_gi_gs(folder: Path, predicted: dict[str, Maps]) -> None:
    write_gs_ir(folder, predicted)
    base = folder / "test" / "ours_None"
    for index, maps in enumerate(predicted.values()):
        png(base / f"pbr/{index:05d}_albedo.png", maps["albedo"])
        png(base / f"pbr/{index:05d}_roughness.png", maps["roughness"].expand(-1, -1, 3))
        png(base / f"normal/{index:05d}_normal.png", maps["normal"].clamp(min=0.75))
        png(base / f"normal/{index:05d}_from_depth.png", maps["normal"])


def write_r3dg(folder: Path, predicted: dict[str, Maps]) -> None:
    for index, (name, maps) in enumerate(predicted.items()):
        kinds = {
            "render": maps["image"],
            "base_color": srgb_encode(maps["albedo"]),
            "roughness": maps["roughness"],
            "normal": maps["normal"],
        }
        for kind, image in kinds.items():
            png(folder / f"eval/{kind}/{image_stem(name)}.png", image)
        for kind, image in kinds.items():
            shown, place = ("renders", 0 * image) if kind == "render" else (kind, image)
            png(folder / f"test/ours_50000/{shown}/{index:05d}.png", place)
        for light, image in relit(maps).items():
            png(folder / f"test_rli/{light}/pbr/{index}.png", image)


def write_svg_ir(folder: Path, predicted: dict[str, Maps], step: int = 1) -> None:
    """Pictures of eval_nvs.py have the true mask beside their colours; ``step`` is what their size is divided by."""
    for index, (name, maps) in enumerate(predicted.items()):
        rough = maps["roughness"].expand(-1, -1, 3)
        kinds = {"base_color": srgb_encode(maps["albedo"]), "roughness": rough, "normal": maps["normal"]}
        png(folder / f"eval/render/{image_stem(name)}.png", maps["image"])
        for kind, image in kinds.items():
            png(folder / f"eval/{kind}/{image_stem(name)}.png", image)
        for kind, image in (kinds | {"renders": maps["image"], "indirect": maps["indirect"]}).items():
            masked = torch.cat([image, maps["alpha"]], -1)[::step, ::step]
            png(folder / f"test/ours_50000/{kind}/{index:05d}.png", masked)
        for light, image in relit(maps).items():
            png(folder / f"test_rli/{light}/pbr/{index}.png", image)


def write_tensoir(folder: Path, predicted: dict[str, Maps]) -> None:
    base = folder / "imgs_test_all"
    for index, maps in enumerate(predicted.values()):
        alpha, blank = maps["alpha"], torch.ones_like(maps["image"])
        rough = on_white(maps["roughness"].expand(-1, -1, 3), alpha)
        png(base / f"nvs_with_brdf/{index:03d}.png", torch.cat([on_white(maps["image"], alpha), blank], 1))
        png(base / f"brdf/{index:03d}.png", torch.cat([on_white(maps["albedo"], alpha), rough, blank], 1))
        png(base / f"normal/{index:03d}.png", torch.cat([maps["normal"], blank, blank, blank], 1))
        for light, image in relit(maps).items():
            place = folder / f"relighting/test_{index:03d}/relighting_without_bg"
            png(place / f"{light}.png", on_white(image, alpha))


def write_ptir_gs(folder: Path, predicted: dict[str, Maps]) -> None:
    base = folder / "lego-0207_101500" / "ours_800"
    for index, maps in enumerate(predicted.values()):
        rough = maps["roughness"].expand(-1, -1, 3)
        kinds = {"pbr": maps["image"], "albedo": maps["albedo"], "roughness": rough, "normals": maps["normal"]}
        for kind, image in (kinds | {"indirect": maps["indirect"], "pbr_gt": maps["alpha"]}).items():
            png(base / f"{kind}/{index:05d}.png", image)
        for light, image in relit(maps).items():
            png(base / f"relight/{light}/pbr/{index:05d}.png", image)


def write_plain(folder: Path, predicted: dict[str, Maps]) -> None:
    for name, maps in predicted.items():
        png(folder / f"image/{name}.png", maps["image"])
        png(folder / f"alpha/{name}.png", maps["alpha"])
        for kind in ("albedo", "roughness"):
            (folder / kind).mkdir(exist_ok=True)
        write_exr(folder / f"albedo/{name}.exr", maps["albedo"].numpy())
        np.save(folder / f"roughness/{name}.npy", maps["roughness"].numpy())
        png(folder / f"normal/{name}.png", maps["normal"])
        png(folder / f"indirect/{name}.png", maps["indirect"])
        for light, image in relit(maps).items():
            png(folder / f"relit/{light}/{name}.png", image)


WRITERS: dict[str, Callable[[Path, dict[str, Maps]], None]] = {
    "radiogs": write_radiogs,
    "irgs": write_irgs,
    "gs-ir": write_gs_ir,
    "gi-gs": write_gi_gs,
    "r3dg": write_r3dg,
    "svg-ir": write_svg_ir,
    "tensoir": write_tensoir,
    "ptir-gs": write_ptir_gs,
    "plain": write_plain,
}
