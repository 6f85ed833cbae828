"""Public data sets: where their files are, how large they are, and where each belongs.

None of the archives was at hand when this was written. Addresses are those that the authors' pages and public codes
name; sizes and checksums are given where one of them states them, and left out elsewhere. The folders that all files of
an archive share are dropped, so that scenes lie where they are expected however they were packed.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from radiogs_core.errors import unknown


@dataclass(frozen=True)
class Piece:
    """A file of a data set.

    ``into``: the folder within the data set's folder that it is unpacked into. ``packed``: whether it is an archive.
    ``by_hand``: only a browser can download it. ``bytes``, ``sha256``: as published, or None and empty if unpublished;
    the digest is then recorded at the first download.
    """

    name: str
    url: str
    into: str = ""
    packed: bool = True
    by_hand: bool = False
    bytes: int | None = None
    sha256: str = ""


@dataclass(frozen=True)
class DataSet:
    """A public data set; ``licence``: its terms, or where they are stated."""

    name: str
    title: str
    page: str
    licence: str
    pieces: tuple[Piece, ...]


ZENODO = "https://zenodo.org/records/7880113"
INVRENDER_MAPS = "https://raw.githubusercontent.com/zju3dv/InvRender/HEAD/code/envmaps"
ORB = "https://downloads.cs.stanford.edu/viscam/StanfordORB"
ENVIRONMENT_MAPS = "https://drive.google.com/file/d/10WLc4zk2idf4xGb6nPL43OXTTHvAXSR3/view"

CAPTURES = (
    ("mold-gold-cape", "moldGoldCape", "c7ef1f0f2a7c2ec5ea7fa3fb43a01ed56fc5216b"),
    ("ethiopian-head", "ethiopianHead", "a7061eb314f07ca6ab8415c3a01bb9bc5fd76b50"),
)
"""NeRD's photographs (Boss et al. 2021): name, repository of vork, and commit, which GitHub packs when it is asked."""

DATA_SETS: Mapping[str, DataSet] = {
    each.name: each
    for each in (
        DataSet(
            "tensoir", "TensoIR-Synthetic", ZENODO, f"stated by {ZENODO}",
            (
                *(
                    Piece(f"{scene}.zip", f"{ZENODO}/files/{scene}.zip?download=1", scene)
                    for scene in ("armadillo", "ficus", "hotdog", "lego")
                ),
                Piece("Environment_Maps.zip", ENVIRONMENT_MAPS, "Environment_Maps", by_hand=True),
            ),
        ),
        DataSet(
            "tensoir-ind", "TensoIR_Ind", "https://github.com/qbhan/RadioGS-public", "not stated by its authors",
            (Piece("TensoIR_Ind.zip", "http://sgvr.kaist.ac.kr/~kbhan/TensoIR_Ind.zip"),),
        ),
        DataSet(
            "synthetic4relight", "Synthetic4Relight", "https://github.com/zju3dv/InvRender",
            "not stated by its authors",
            (
                Piece(
                    "Synthetic4Relight.zip",
                    "https://drive.google.com/file/d/1wWWu7EaOxtVq8QNalgs6kDqsiAm7xsRh/view", by_hand=True,
                ),
                *(
                    Piece(f"{name}.exr", f"{INVRENDER_MAPS}/{name}.exr", packed=False, sha256=digest)
                    for name, digest in (
                        ("envmap3", "6b0a05898b32278f26cf928b271ccdb28b4db65c7200739b2b987bb24e7ab1ca"),
                        ("envmap6", "1075b99c0dec28cd92c3070b5a61b13b15ef990926345b64eae95f704e948b73"),
                        ("envmap12", "cca4cf9722ccdb781a34da6a6f61e50a5dafacdf638b5a4603025cd526e44913"),
                    )
                ),
            ),
        ),
        DataSet(
            "stanford-orb", "Stanford-ORB", "https://stanfordorb.github.io", "stated by https://stanfordorb.github.io",
            (
                Piece("blender_LDR.tar.gz", f"{ORB}/blender_LDR.tar.gz", "blender_LDR", bytes=11_611_255_093),
                Piece("ground_truth.tar.gz", f"{ORB}/ground_truth.tar.gz", "ground_truth", bytes=5_057_562_274),
            ),
        ),
        DataSet(
            "mipnerf360", "Mip-NeRF 360", "https://jonbarron.info/mipnerf360",
            "stated by https://jonbarron.info/mipnerf360",
            (Piece("360_v2.zip", "https://storage.googleapis.com/gresearch/refraw360/360_v2.zip"),),
        ),
        *(
            DataSet(
                name, f"{of} of NeRD", f"https://github.com/vork/{of}", "CC BY-NC-SA 4.0, not for commercial use",
                (Piece(f"{of}-{commit}.zip", f"https://github.com/vork/{of}/archive/{commit}.zip"),),
            )
            for name, of, commit in CAPTURES
        ),
    )
}  # fmt: skip


def data_set(name: str) -> DataSet:
    """The data set of that name. Raises UsageError for an unknown one."""
    if name not in DATA_SETS:
        raise unknown("data set", name, DATA_SETS)
    return DATA_SETS[name]
