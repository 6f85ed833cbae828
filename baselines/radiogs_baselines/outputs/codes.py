"""The layouts of the public codes' output folders, as their evaluation scripts write them (see docs/protocols.md).

If a code writes one quantity twice, the reader takes the file from which the code computes its own metrics, unless a
remark states otherwise.
"""

from collections.abc import Mapping
from dataclasses import replace

from .layout import Code, Encoding, Rule, Unread

YUP = "Its relighting looks the environment map up without turning it from Y up to Z up."
ONE_NAME = (
    "it names files by the last part of the image's path, which is 'rgba' for every view of the TensoIR layout: "
    "each view overwrote the one before"
)

RADIOGS = Code(
    title="RadioGS (released code): the stage-2 folder",
    rules=(
        Rule("image", "test/ours_*/render/{index:05d}.png", "display"),
        Rule("alpha", "test/ours_*/rend_alpha/{index:05d}.png", "value"),
        Rule("albedo", "test/ours_*/base_color_linear/{index:05d}.png", "linear"),
        Rule("roughness", "test/ours_*/roughness/{index:05d}.png", "value"),
        Rule("normal", "test/ours_*/rend_normal/{index:05d}.png", "normal"),
        Rule("incident", "test/ours_*/light_indirect/{index:05d}.png", "radiance"),
        Rule("indirect", "test/ours_*/render_indirect/{index:05d}.png", "radiance"),
    ),
    relit=(
        Rule("relit", "test_rli_light/envmap_{light}/render/{index}.png", "display"),
        Rule("relit", "test_rli/{light}/render/{index}.png", "display"),
    ),
    marks=("test/ours_*/light_indirect", "test/ours_*/render_radiosity"),
    remarks=("Relit under test_rli (Synthetic4Relight), its lights are called env6 and env12: envmap6 and envmap12.",),
    unread=(
        Unread("test/ours_*/render_sh/*", "the radiance that surfels carry, not the physically based image"),
        Unread("test/ours_*/base_color/*", "albedo as sRGB; base_color_linear holds the same"),
        Unread("test/ours_*/render_radiosity/*", "twice the radiance, clipped"),
    ),
    over=("irgs",),
)

IRGS = Code(
    title="IRGS: the stage-2 folder",
    rules=tuple(rule for rule in RADIOGS.rules if rule.map not in ("incident", "indirect")),
    relit=RADIOGS.relit,
    marks=("test/ours_*/base_color_linear",),
    remarks=("The shipped scripts pass --no_save: render without it, or only the relit images exist.",),
    unread=(Unread("test/ours_*/base_color/*", "albedo as sRGB; base_color_linear holds the same"),),
)

GS_IR = Code(
    title="GS-IR",
    rules=(
        Rule("image", "test/ours_*/pbr/{index:05d}.png", "display"),
        Rule("albedo", "test/ours_*/pbr/{index:05d}_brdf.png", "linear", part=(0, 3)),
        Rule("roughness", "test/ours_*/pbr/{index:05d}_brdf.png", "value", part=(1, 3)),
        Rule("normal", "test/ours_*/normal/{index:05d}_normal.png", "normal"),
    ),
    relit=(Rule("relit", "test/ours_*/relight/{index:05d}_{light}.png", "display"),),
    marks=("test/ours_*/pbr/00000_brdf.png",),
    remarks=(
        "Relit images are taken for sRGB: they are only if relight.py ran with --gamma.",
        "Roughness is as rendered: training maps it to 0.04 + 0.96 r, rendering does not.",
        YUP,
    ),
    unread=(
        Unread("test/ours_*/pbr/*_albedo.png", "albedo that --brdf_eval has scaled to the truth"),
        Unread("test/envmap*.png", "the light clipped to [0, 1]"),
    ),
)

GI_GS = Code(
    title="GI-GS",
    rules=(
        Rule("image", "test/ours_*/pbr/{index:05d}.png", "display"),
        Rule("albedo", "test/ours_*/pbr/{index:05d}_albedo.png", "linear"),
        Rule("roughness", "test/ours_*/pbr/{index:05d}_roughness.png", "value"),
        Rule("normal", "test/ours_*/normal/{index:05d}_from_depth.png", "normal"),
    ),
    relit=GS_IR.relit,
    marks=("test/ours_*/pbr/00000_DIR.png", "test/ours_*/pbr/00000_roughness.png"),
    remarks=(GS_IR.remarks[0], YUP),
    unread=(
        Unread("test/ours_*/normal/*_normal.png", "normals clamped before they are encoded: their signs are lost"),
        Unread("test/envmap*.png", "the light clipped to [0, 1]"),
    ),
    over=("gs-ir",),
)

R3DG = Code(
    title="Relightable 3D Gaussian (R3DG)",
    rules=(
        Rule("image", "eval/render/{name}.png", "display"),
        Rule("albedo", "eval/base_color/{name}.png", "srgb"),
        Rule("roughness", "eval/roughness/{name}.png", "value"),
        Rule("normal", "eval/normal/{name}.png", "normal"),
        Rule("albedo", "test/ours_*/base_color/{index:05d}.png", "srgb"),
        Rule("roughness", "test/ours_*/roughness/{index:05d}.png", "value"),
        Rule("normal", "test/ours_*/normal/{index:05d}.png", "normal"),
    ),
    relit=(Rule("relit", "test_rli/{light}/pbr/{index}.png", "display"),),
    marks=("eval/base_color", "test_rli/*/pbr", "test/ours_*/global_lights"),
    remarks=(
        "Its lights are called env6 and env12: envmap6 and envmap12.",
        "Relit images use factors for the albedo that its script has for four scenes of the authors' own runs.",
    ),
    unread=(
        Unread("eval/*/rgba.png", ONE_NAME),
        Unread("test/ours_*/renders/*", "the SH image, not the physically based one"),
        Unread("test_rli/*/base_color/*", "albedo scaled by its script's factors"),
    ),
)

QUARTER = "eval_nvs.py renders at a quarter of the resolution unless its two 4 are made 1"

SVG_IR = Code(
    title="SVG-IR",
    rules=(
        *(rule for rule in R3DG.rules if rule.path.startswith("eval")),
        Rule("image", "test/ours_*/renders/{index:05d}.png", "display", other_size=QUARTER),
        *(replace(rule, other_size=QUARTER) for rule in R3DG.rules if rule.path.startswith("test")),
    ),
    relit=R3DG.relit,
    marks=("test/ours_*/indirect", "test_rli/*/local_lights"),
    remarks=("Its relighting script runs three of five lights unless its list is made whole.",),
    unread=(
        Unread("eval/*/rgba.png", ONE_NAME),
        Unread("test_rli/*/base_color/*", "albedo that is not masked"),
    ),
    over=("r3dg",),
)

TENSOIR = Code(
    title="TensoIR: the experiment's folder, or a scene's folder under relighting",
    rules=(
        Rule("image", "imgs_test_all/nvs_with_brdf/{index:03d}.png", "display", "white", (0, 2)),
        Rule("albedo", "imgs_test_all/brdf/{index:03d}.png", "linear", "white", (0, 3)),
        Rule("roughness", "imgs_test_all/brdf/{index:03d}.png", "value", "white", (1, 3)),
        Rule("normal", "imgs_test_all/normal/{index:03d}.png", "normal", part=(0, 4)),
    ),
    relit=(
        Rule("relit", "relighting/test_{index:03d}/relighting_without_bg/{light}.png", "display", "white"),
        Rule("relit", "test_{index:03d}/relighting_without_bg/{light}.png", "display", "white"),
    ),
    marks=("imgs_test_all/nvs_with_brdf", "imgs_test_all/brdf", "test_000/relighting_without_bg"),
    remarks=("To score all at once, put relighting/<scene> into the experiment's folder as relighting.",),
    unread=(
        Unread("imgs_test_all/nvs_with_radiance_field/*", "views of the radiance field, not physically based ones"),
        Unread("imgs_test_all/brdf/*_albedo.png", "albedo that was scaled to the truth"),
        Unread("imgs_test_all/envir_map/*", "the light clipped to [0, 1]"),
        Unread("imgs_vis/**/*", "snapshots of five views"),
        Unread("**/test_*/albedo*.png", "albedo that was scaled view by view"),
    ),
)

PTIR_GS = Code(
    title="PTIR-GS: the folder of an inversion, with its runs",
    rules=(
        Rule("image", "*/ours_*/pbr/{index:05d}.png", "display"),
        Rule("albedo", "*/ours_*/albedo/{index:05d}.png", "linear"),
        Rule("roughness", "*/ours_*/roughness/{index:05d}.png", "value"),
        Rule("normal", "*/ours_*/normals/{index:05d}.png", "normal"),
        Rule("indirect", "*/ours_*/indirect/{index:05d}.png", "radiance"),
    ),
    relit=(Rule("relit", "*/ours_*/relight/{light}/pbr/{index:05d}.png", "display"),),
    marks=("*/ours_*/albedo", "*/ours_*/relight/*/pbr"),
    remarks=("What it shows is multiplied by the true masks, and relit with an albedo that was scaled to the truth.",),
    unread=(Unread("**/*gt/*", "the truth"), Unread("*/ours_*/albedo_scaled/*", "albedo that was scaled to the truth")),
    environment=("*/ckpt_last_environment.exr",),
)

PLAIN_MAPS: Mapping[str, Encoding] = {
    "image": "display",
    "alpha": "value",
    "albedo": "linear",
    "roughness": "value",
    "normal": "normal",
    "depth": "value",
    "indirect": "radiance",
    "incident": "radiance",
}

IMAGE_FOLDERS = ("image/", "render/", "renders/", "", "test/ours_*/renders/")
"""Folders that are tried for images of the plain layout: the folder itself, and where 3DGS writes its renders."""


def _plain(kind: str, folder: str, encoding: Encoding) -> tuple[Rule, Rule]:
    """Files that are called as the views are, or numbered in the order of the test views."""
    return (
        Rule(kind, f"{folder}{{name}}", encoding, "own coverage"),
        Rule(kind, f"{folder}{{number}}", encoding, "own coverage"),
    )


PLAIN = Code(
    title="the plain layout for everyone else",
    rules=(
        *(rule for folder in IMAGE_FOLDERS for rule in _plain("image", folder, "display")),
        *(rule for name, held in PLAIN_MAPS.items() if name != "image" for rule in _plain(name, f"{name}/", held)),
    ),
    relit=_plain("relit", "relit/{light}/", "display"),
    marks=("image", "relit"),
    environment=("environment.exr", "environment.hdr", "environment.npy"),
)

CODES: Mapping[str, Code] = {
    "radiogs": RADIOGS,
    "irgs": IRGS,
    "gs-ir": GS_IR,
    "gi-gs": GI_GS,
    "r3dg": R3DG,
    "svg-ir": SVG_IR,
    "tensoir": TENSOIR,
    "ptir-gs": PTIR_GS,
    "plain": PLAIN,
}
