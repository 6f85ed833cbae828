"""Suites on public data sets, which users download: the paper's main tables, and the cost of frames of whole rooms.

Tables of the paper use the protocol of RadioGS's own evaluation, which produced them.
"""

from collections.abc import Mapping
from dataclasses import replace

from radiogs_baselines.published import published
from radiogs_core.errors import UsageError

from .baselines import PUBLISHED_METHODS, RECOMMENDED
from .suite import Row, Suite, knob_rows, metrics

OURS = Row("ours", "Ours", "Ours", {})
OURS_FINETUNED = Row("ours-finetuned", "Ours*", "Ours* (relit by fine-tuned surfels)", {"relighting": "surfels"})

TENSOIR = Suite(
    name="tensoir",
    data_set="tensoir",
    title="TensoIR-Synthetic",
    published="tensoir",
    reference="ours",
    rows=(OURS, OURS_FINETUNED, RECOMMENDED, *PUBLISHED_METHODS),
    columns=metrics("nvs/psnr,ssim,lpips", "normal/mae", "albedo/psnr,ssim,lpips", "relight/psnr,ssim,lpips"),
    scenes=("armadillo", "ficus", "hotdog", "lego"),
    protocol="radiogs",
    recipe="printed",
    download=(
        "TensoIR-Synthetic is Zenodo's record 7880113; its environment maps (linked to by the README of"
        " Haian-Jin/TensoIR) belong beside the scenes, in Environment_Maps/."
    ),
)

SYNTHETIC4RELIGHT = Suite(
    name="synthetic4relight",
    data_set="synthetic4relight",
    title="Synthetic4Relight",
    published="synthetic4relight",
    reference="ours",
    rows=(OURS, RECOMMENDED, *PUBLISHED_METHODS),
    columns=metrics("nvs/psnr", "roughness/mse", "albedo/psnr", "relight/psnr"),
    scenes=("air_baloons", "chair", "hotdog", "jugs"),
    protocol="radiogs",
    recipe="printed",
    download=(
        "The README of zju3dv/InvRender links to Synthetic4Relight; envmap3.exr, envmap6.exr and envmap12.exr (there in"
        " code/envmaps) belong beside the scenes."
    ),
)

CAPTURES = {
    "baking": (1, 2, 3), "ball": (2, 3, 4), "blocks": (2, 5, 6), "cactus": (1, 5, 7), "car": (2, 4, 6),
    "chips": (2, 3, 4), "cup": (3, 6, 7), "curry": (1, 5, 7), "gnome": (3, 5, 7), "grogu": (1, 2, 3),
    "pepsi": (2, 3, 4), "pitcher": (1, 5, 7), "salt": (4, 5, 7), "teapot": (1, 2, 6),
}  # fmt: skip
"""Stanford-ORB's objects, with the environments in which each was captured."""

STANFORD_ORB = Suite(
    name="stanford-orb",
    data_set="stanford-orb",
    title="Stanford-ORB",
    published=None,  # the paper shows pictures of it, and no table
    reference="ours",
    rows=(OURS, OURS_FINETUNED, RECOMMENDED, *PUBLISHED_METHODS),
    columns=metrics(
        "nvs/psnr_h,psnr_l,ssim,lpips", "relight/psnr_h,psnr_l,ssim,lpips", "normal/cosine", "depth/simse",
        "albedo/psnr,ssim,lpips",
    ),
    scenes=tuple(f"{name}_scene{place:03}" for name, places in CAPTURES.items() for place in places),
    protocol="stanford-orb",
    recipe="printed",
    download=(
        "stanfordorb.github.io links to blender_LDR and ground_truth, which belong side by side; blender_LDR holds a"
        " folder a capture."
    ),
)  # fmt: skip

ROOMS = ("bonsai", "counter", "kitchen", "room")
FROM_MIPNERF360 = "jonbarron.info/mipnerf360 links to 360_v2.zip; a scene is a folder with images_2/ and sparse/0/."
COST_OF_A_FRAME = metrics("nvs/ms,megabytes,psnr,ssim,lpips")

MIPNERF360_NG = Suite(
    name="mipnerf360-ng",
    data_set="mipnerf360",
    title="Cost of a frame of whole rooms over N_g",
    published="mipnerf360-ng",
    reference="ng-2048",
    rows=knob_rows("ng", "N_g", "consistency_surfels", (1024, 2048, 4096, 8192, 16384)),
    columns=COST_OF_A_FRAME,
    scenes=ROOMS,
    recipe="printed",
    download=FROM_MIPNERF360,
)  # fmt: skip

MIPNERF360_NS = Suite(
    name="mipnerf360-ns",
    data_set="mipnerf360",
    title="Cost of a frame of whole rooms over N_s",
    published="mipnerf360-ns",
    reference="ns-64",
    rows=knob_rows("ns", "N_s", "incident_samples", (16, 32, 64), {"consistency_surfels": 2048}),
    columns=COST_OF_A_FRAME,
    scenes=ROOMS,
    recipe="printed",
    download=FROM_MIPNERF360,
)

DATA_SET_SUITES = (TENSOIR, SYNTHETIC4RELIGHT, STANFORD_ORB, MIPNERF360_NG, MIPNERF360_NS)

DOWNLOADS: Mapping[str, str] = {
    "tensoir-ind": (
        "The README of qbhan/RadioGS-public links to TensoIR_Ind; `datasets blend` renders the like of it from the"
        " scenes' .blend files (docs/datasets.md)."
    ),
    **{suite.data_set: suite.download for suite in DATA_SET_SUITES},
}
"""Where to download the data sets of the paper's tables, by name."""


def as_published(suite: Suite) -> Suite:
    """The suite on the scenes, under the protocol and by the recipe of the table that it reproduces.

    Its preset is ``paper``. Raises UsageError for a suite that reproduces no table.
    """
    if suite.published is None:
        raise UsageError(
            f"suite '{suite.name}' reproduces no published table",
            "",
            "Which suites do: docs/suites.md",
        )
    conditions = published(suite.published).conditions
    return replace(
        suite,
        scenes=conditions.scenes,
        protocol=conditions.protocol,
        recipe=suite.recipe or "printed",
        data_set=conditions.data_set,
        download=DOWNLOADS[conditions.data_set],
    )
