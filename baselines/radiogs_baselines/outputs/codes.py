"""The layouts of the public codes' output folders, as their evaluation scripts write them (see docs/scoring.md).

Where a code writes one quantity twice, the file that its own figures are computed from is read, unless a remark says
otherwise.
"""

from collections.abc import Mapping

from .rules import Code, Rule

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
    relit=(Rule("relit", "test_rli_light/envmap_{light}/render/{index}.png", "display"),),
    marks=("test/ours_*/light_indirect", "test/ours_*/render_radiosity"),
    over=("irgs",),
)

IRGS = Code(
    title="IRGS: the stage-2 folder",
    rules=tuple(rule for rule in RADIOGS.rules if rule.map not in ("incident", "indirect")),
    relit=RADIOGS.relit,
    marks=("test/ours_*/base_color_linear",),
    remarks=("The shipped scripts pass --no_save: render without it, or only the relit images exist.",),
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
        "Images are sRGB only if trained and rendered with --gamma.",
        "Its relighting looks the environment map up without turning it from Y up to Z up.",
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
    marks=("test/ours_*/pbr/00000_DIR.png", "test/ours_*/pbr/00000_albedo.png"),
    over=("gs-ir",),
    remarks=(
        "Normals are read from *_from_depth.png: *_normal.png is clamped before it is encoded and has lost its signs.",
        "Its relighting looks the environment map up without turning it from Y up to Z up.",
    ),
)

R3DG = Code(
    title="Relightable 3D Gaussian (R3DG)",
    rules=(
        Rule("image", "eval/render/{name}.png", "display"),
        Rule("albedo", "eval/base_color/{name}.png", "srgb"),
        Rule("roughness", "eval/roughness/{name}.png", "value"),
        Rule("normal", "eval/normal/{name}.png", "normal"),
    ),
    relit=(Rule("relit", "test_rli/{light}/pbr/{index}.png", "display"),),
    marks=("eval/base_color", "test_rli/env6"),
    remarks=(
        "New views are read from eval/render: test/ours_*/renders holds the SH image.",
        "Its lights are called env6 and env12; they are matched with envmap6 and envmap12.",
    ),
)

SVG_IR = Code(
    title="SVG-IR",
    rules=R3DG.rules,
    relit=R3DG.relit,
    marks=("test/ours_*/indirect", "test_rli/*/local_lights"),
    over=("r3dg",),
    remarks=("New views are read from eval/render: test/ours_* has a quarter of the resolution.",),
)

TENSOIR = Code(
    title="TensoIR: the experiment's folder",
    rules=(
        Rule("image", "imgs_test_all/nvs_with_brdf/{index:03d}.png", "display", "white", (0, 2)),
        Rule("albedo", "imgs_test_all/brdf/{index:03d}.png", "linear", "white", (0, 3)),
        Rule("roughness", "imgs_test_all/brdf/{index:03d}.png", "value", "white", (1, 3)),
        Rule("normal", "imgs_test_all/normal/{index:03d}.png", "normal", part=(0, 4)),
    ),
    relit=(Rule("relit", "relighting/test_{index:03d}/relighting_without_bg/{light}.png", "display", "white"),),
    marks=("imgs_test_all/nvs_with_brdf", "imgs_test_all/brdf"),
    remarks=(
        "New views are the physically based ones (nvs_with_brdf), not those of the radiance field.",
        "Relit images use an albedo that was scaled per view; put relighting/<scene> here as relighting.",
    ),
)

PLAIN = Code(
    title="the plain layout for everyone else",
    rules=(
        Rule("image", "image/{name}", "display"),
        Rule("alpha", "alpha/{name}", "value"),
        Rule("albedo", "albedo/{name}", "linear"),
        Rule("roughness", "roughness/{name}", "value"),
        Rule("normal", "normal/{name}", "normal"),
        Rule("depth", "depth/{name}", "value"),
        Rule("indirect", "indirect/{name}", "radiance"),
        Rule("incident", "incident/{name}", "radiance"),
    ),
    relit=(Rule("relit", "relit/{light}/{name}", "display"),),
    marks=("image",),
    remarks=("Without a suffix in the rule, .exr, .npy and .png are looked for, in this order.",),
)

CODES: Mapping[str, Code] = {
    "radiogs": RADIOGS,
    "irgs": IRGS,
    "gs-ir": GS_IR,
    "gi-gs": GI_GS,
    "r3dg": R3DG,
    "svg-ir": SVG_IR,
    "tensoir": TENSOIR,
    "plain": PLAIN,
}
