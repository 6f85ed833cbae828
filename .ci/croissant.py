"""Describes the committed sets of scenes as Croissant 1.1 (mlcommons.org/croissant), from their own metadata.

    python .ci/croissant.py

Writes ``SET.croissant.json`` beside each set's folder. ``make croissant`` validates the files, and a test
compares them with the folders.
"""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

SETS = Path(__file__).parents[1] / "datasets" / "radiogs_datasets"

TITLES = {
    "tiny": "Scenes of radiogs-bench: path-traced miniatures for inverse rendering",
    "forward": "Larger views of some scenes of radiogs-bench, for comparing renderers",
    "others": "Scenes of radiogs-bench with shapes and lights made by other hands",
}
"""The titles of the sets, by folder."""

LICENCE = "https://spdx.org/licenses/Apache-2.0.html"
"""The licence of sets whose scenes name none: the project's."""

AUTHORS = "the authors of radiogs-bench"

CONTEXT = {
    "@language": "en", "@vocab": "https://schema.org/", "arrayShape": "cr:arrayShape", "citeAs": "cr:citeAs",
    "column": "cr:column", "conformsTo": "dct:conformsTo", "containedIn": "cr:containedIn",
    "cr": "http://mlcommons.org/croissant/", "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"}, "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty", "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract", "field": "cr:field", "fileObject": "cr:fileObject", "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet", "format": "cr:format", "includes": "cr:includes", "isArray": "cr:isArray",
    "isLiveDataset": "cr:isLiveDataset", "jsonPath": "cr:jsonPath", "key": "cr:key", "md5": "cr:md5",
    "parentField": "cr:parentField", "path": "cr:path", "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet", "references": "cr:references", "regex": "cr:regex", "repeated": "cr:repeated",
    "replace": "cr:replace", "samplingRate": "cr:samplingRate", "sc": "https://schema.org/",
    "separator": "cr:separator", "source": "cr:source", "subField": "cr:subField", "transform": "cr:transform",
}  # fmt: skip
"""The context that the format prescribes."""


def described(folder: Path) -> dict[str, Any]:
    """The description of a set: its licence, credits, files and views."""
    scenes = {each.parent.name: json.loads(each.read_text()) for each in sorted(folder.glob("*/metadata.json"))}
    told = "; ".join(f"{name}: {about['purpose']} ({about['choices']})" for name, about in scenes.items())
    credits = {str(each): each for about in scenes.values() for each in about.get("credits", [])}
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "name": f"radiogs-bench-{folder.name}",
        "description": f"{TITLES[folder.name]}. {told}.",
        "license": sorted({about.get("licence", LICENCE) for about in scenes.values()}),
        "creator": [{"@type": "sc:Organization", "name": AUTHORS}],
        "isBasedOn": [based_on(each) for each in credits.values()],
        "url": "https://arxiv.org/abs/2603.01491",
        "version": "0.1.0",
        "distribution": file_sets(folder.name),
        "recordSet": record_sets(),
    }


def file_sets(name: str) -> list[dict[str, Any]]:
    """The files of a set, each kind by a pattern."""
    return [
        files("images", "image/png", f"{name}/*/t*/rgba.png", "Views, display sRGB with straight alpha."),
        files("cameras", "application/json", f"{name}/*/transforms_*.json", "Cameras of the views of a split."),
        files("albedo", "image/png", f"{name}/*/test_*/albedo.png", "Linear albedo of the test views."),
        files("normals", "image/png", f"{name}/*/test_*/normal.png", "World normals of the test views."),
        files("roughness", "image/png", f"{name}/*/test_*/roughness.png", "Roughness of the test views."),
        files("relit", "image/png", f"{name}/*/test_*/rgba_*.png", "The test views under the other lights."),
        files(
            "radiance",
            "image/x-exr",
            f"{name}/*/test_*/*.exr",
            "Linear light, and depth, of the test views.",
        ),
        files("lights", "image/vnd.radiance", f"{name}/**/*.hdr", "Lights, latitude-longitude, Z up."),
    ]


def record_sets() -> list[dict[str, Any]]:
    """The views of a set with scene and split, and their poses."""
    return [
        {
            "@type": "cr:RecordSet",
            "@id": "views",
            "name": "views",
            "description": "The views of all scenes.",
            "field": [
                view_field(
                    "image",
                    "sc:ImageObject",
                    {"fileProperty": "content"},
                    "Colour; alpha, where there is any, is coverage.",
                ),
                view_field(
                    "scene",
                    "sc:Text",
                    {"fileProperty": "fullpath"},
                    "The scene's folder.",
                    r"(?:.*/)?([^/]+)/[^/]+/rgba\.png$",
                ),
                view_field(
                    "split",
                    "sc:Text",
                    {"fileProperty": "fullpath"},
                    "train or test.",
                    r".*/(train|test)_\d+/rgba\.png$",
                ),
            ],
        },
        {
            "@type": "cr:RecordSet",
            "@id": "poses",
            "name": "poses",
            "description": "Camera-to-world matrices in OpenGL's frame, by the views' file names.",
            "field": [
                pose_field("file", "sc:Text", "$.frames[*].file_path", "File of the view, without its ending."),
                pose_field("to_world", "cr:Float64", "$.frames[*].transform_matrix", "The matrix.")
                | {"isArray": True, "arrayShape": "4,4"},
            ],
        },
    ]


def based_on(credit: Mapping[str, str]) -> dict[str, Any]:
    """A mesh or map of others as a work that a set is based on."""
    return {
        "@type": "sc:CreativeWork", "name": credit["title"], "license": credit["licence"], "url": credit["source"],
        "creator": {"@type": "sc:Person", "name": credit["author"]},
    }  # fmt: skip


def files(name: str, encoding: str, pattern: str, description: str) -> dict[str, Any]:
    """Files of a set by a pattern."""
    return {
        "@type": "cr:FileSet", "@id": name, "name": name, "description": description, "encodingFormat": encoding,
        "includes": pattern,
    }  # fmt: skip


def view_field(name: str, kind: str, extract: Mapping[str, str], description: str, regex: str = "") -> dict[str, Any]:
    """A field of the views, read from their image files or from the paths of these."""
    source = {"fileSet": {"@id": "images"}, "extract": extract} | ({"transform": {"regex": regex}} if regex else {})
    return {"@type": "cr:Field", "@id": f"views/{name}", "name": name, "description": description, "dataType": kind,
            "source": source}  # fmt: skip


def pose_field(name: str, kind: str, path: str, description: str) -> dict[str, Any]:
    """A field of the cameras, read from the transforms files."""
    source = {"fileSet": {"@id": "cameras"}, "extract": {"jsonPath": path}}
    return {"@type": "cr:Field", "@id": f"poses/{name}", "name": name, "description": description, "dataType": kind,
            "source": source}  # fmt: skip


def text_of(folder: Path) -> str:
    """The file of a set as text."""
    return json.dumps(described(folder), indent=1, ensure_ascii=False) + "\n"


def sets() -> list[Path]:
    """The folders of the committed sets."""
    return [SETS / name for name in TITLES if (SETS / name).is_dir()]


def main() -> int:
    """Write every file."""
    for folder in sets():
        path = folder.with_suffix(".croissant.json")
        path.write_text(text_of(folder), encoding="utf-8")
        sys.stdout.write(f"{path}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
