"""Damages scenes and suites at random and reads them: each is refused by name, or read as written.

    python -m bench.fuzz scenes [COUNT] [SEED]
    python -m bench.fuzz suites [COUNT] [SEED]

Prints how many were refused; read exactly as before the damage; read with other values ("as it says"), which must be
those of a plain second reading of the same files; read with values that are not ("silent"); and how many ended in an
error that is not explained, took over a minute or over 4 GiB. Exit code 1 if there is any of the latter four.
"""

import json
import random
import resource
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from bench.own_suite import WHOLE
from radiogs_bench.suites.registry import read_suite
from radiogs_core.errors import ExplainedError
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets import load_scene
from radiogs_datasets.registry import TINY

PARTS = ("envmaps", "train_000", "train_001", "test_000", "test_001")
STRANGE: tuple[Any, ...] = (
    None, True, "", "..", "/etc/passwd", "\x00", "a" * 300, "\u202e", [], {}, -1, 0, 0.5, 1e300, -1e19, 1e-300, 1 << 70,
    [[1]], float("nan"), float("inf"), 3.2, [0.0] * 4,
)  # fmt: skip
WRONG = ("silent", "unexpected", "slow", "memory")
Numbers = random.Random


def small_scene(folder: Path) -> Path:
    """`corner` with two views of each split."""
    for part in PARTS:
        shutil.copytree(TINY / "corner" / part, folder / part)
    for split in ("train", "test"):
        table = json.loads((TINY / "corner" / f"transforms_{split}.json").read_text())
        table["frames"] = table["frames"][:2]
        (folder / f"transforms_{split}.json").write_text(json.dumps(table))
    return folder


def damaged(content: bytes, other: bytes, numbers: Numbers) -> bytes:
    """Some bytes changed, zeroed, taken out, doubled, the end cut off, or another file's content."""
    kind, start = numbers.randrange(6), numbers.randrange(max(1, len(content)))
    stop = min(len(content), start + numbers.choice((1, 1, 2, 8, 64, 512)))
    part = content[start:stop]
    return {
        0: content[:start] + bytes(byte ^ numbers.randrange(1, 256) for byte in part) + content[stop:],
        1: content[:start] + bytes(len(part)) + content[stop:],
        2: content[:start] + content[stop:],
        3: content[:stop] + part + content[stop:],
        4: content[:start],
        5: other,
    }[kind]


def places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every container and key within a JSON value."""
    for key, inner in list(value.items() if isinstance(value, dict) else enumerate(value)):
        yield value, key
        if isinstance(inner, dict | list):
            yield from places(inner)


def twisted(table: Any, numbers: Numbers) -> bytes:
    """JSON with one value taken out, or another in its place."""
    container, key = numbers.choice(list(places(table)))
    if numbers.random() < 0.2:
        del container[key]
    elif isinstance(container[key], float) and numbers.random() < 0.5:
        container[key] *= numbers.choice((-1, 1 + 1e-6, 1.5, 1e6, 1e-6, 1e19))
    else:
        container[key] = numbers.choice(STRANGE)
    return json.dumps(table).encode("utf-8", "surrogatepass")


def damage_scene(folder: Path, numbers: Numbers) -> tuple[Path, bytes]:
    """Damage one file of a scene; returns which, and what it held."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    tables = [path for path in files if path.name.startswith("transforms")]
    path = numbers.choice(tables if numbers.random() < 0.3 else files)
    whole = path.read_bytes()
    if path in tables and numbers.random() < 0.8:
        path.write_bytes(twisted(json.loads(whole), numbers))
    elif numbers.random() < 0.05:
        path.unlink()
    else:
        path.write_bytes(damaged(whole, numbers.choice(files).read_bytes(), numbers))
    return path, whole


def values(scene: Scene) -> dict[str, torch.Tensor]:
    """Everything that is made of a scene's files: maps, cameras and lights, by name."""
    found = {name: light.radiance for name, light in scene.lights.items()}
    for split, views in (("train", scene.train), ("test", scene.test)):
        for view in views:
            lens = view.camera
            found[f"{split} {view.name} camera"] = torch.cat(
                [lens.camera_to_world.flatten(), torch.tensor([lens.fx, lens.fy, lens.cx, lens.cy])]
            )
            found |= {f"{split} {view.name} {name}": view.read(name) for name in view.sources}
    return found


def agrees(folder: Path, scene: Scene) -> bool:
    """Whether cameras and images are those of a plain second reading, and everything is finite."""
    if not all(bool(torch.isfinite(value).all()) for value in values(scene).values()):
        return False
    for split, views in (("train", scene.train), ("test", scene.test)):
        table = json.loads((folder / f"transforms_{split}.json").read_text())
        if len(table["frames"]) != len(views):
            return False
        by_name = {Path(frame["file_path"]).parts[0]: frame for frame in table["frames"]}
        if not all(_as_written(folder, table, by_name[view.name.split("/")[0]], view) for view in views):
            return False
    return True


def _as_written(folder: Path, table: dict[str, Any], frame: dict[str, Any], view: View) -> bool:
    image = np.asarray(Image.open(folder / f"{frame['file_path']}.png"))
    pose = np.array(frame["transform_matrix"], float) * [1, -1, -1, 1]
    angle = frame.get("camera_angle_x", table.get("camera_angle_x"))
    focal = table["fl_x"] if "fl_x" in table else 0.5 * image.shape[1] / np.tan(0.5 * angle)
    return bool(
        np.allclose(view.camera.camera_to_world[:3].double(), pose[:3], rtol=1e-3, atol=1e-3)
        and np.isclose(view.camera.fx, focal, rtol=1e-4)
        and np.allclose(view.read("image").numpy(), image[..., :3] / 255, atol=1e-6)
    )


def outcome(read: Callable[[], str], label: str) -> str:
    """The outcome of one reading, with its time and the process's memory."""
    begun = time.monotonic()
    try:
        found = read()
    except ExplainedError as error:
        str(error).encode()
        found = "refused"
    except Exception:  # noqa: BLE001  counted, and shown
        sys.stderr.write(f"{label}\n{traceback.format_exc()}")
        found = "unexpected"
    if time.monotonic() - begun > 60:
        return "slow"
    return "memory" if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > 4 << 20 else found


def scenes(count: int, seed: int) -> Counter[str]:
    """Outcomes of damaged scenes."""
    numbers, found = Numbers(seed), Counter[str]()
    with tempfile.TemporaryDirectory() as place:
        folder = small_scene(Path(place) / "corner")
        before = values(load_scene(str(folder)))

        def read() -> str:
            scene = load_scene(str(folder))
            now = values(scene)
            if now.keys() == before.keys() and all(torch.equal(now[name], before[name]) for name in now):
                return "as before"
            return "as it says" if agrees(folder, scene) else "silent"

        for number in range(count):
            path, whole = damage_scene(folder, numbers)
            kind = outcome(read, f"scene {number}: {path.name}")
            if kind == "silent":
                kept = Path(tempfile.gettempdir()) / f"silent-{seed}-{number}-{path.name}"
                kept.write_bytes(path.read_bytes() if path.exists() else b"")
                sys.stderr.write(f"scene {number}: {path.relative_to(folder)} is read for something else: {kept}\n")
            found[kind] += 1
            path.write_bytes(whole)
    return found


def suites(count: int, seed: int) -> Counter[str]:
    """Outcomes of damaged suite files."""
    numbers, found = Numbers(seed), Counter[str]()
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / "suite.toml"
        file.write_text(WHOLE)
        before = read_suite(file)
        for number in range(count):
            content = WHOLE.encode()
            for _ in range(numbers.randrange(1, 4)):
                content = damaged(content, numbers.choice(STRANGE_TEXTS), numbers)
            if numbers.random() < 0.5:
                lines = WHOLE.splitlines()
                spot = numbers.choice([place for place, line in enumerate(lines) if "=" in line])
                lines[spot] = f"{lines[spot].split('=')[0]}= {numbers.choice(STRANGE_VALUES)}"
                content = "\n".join(lines).encode()
            file.write_bytes(content)
            found[outcome(lambda: "as before" if read_suite(file) == before else "as it says", f"suite {number}")] += 1
    return found


STRANGE_TEXTS = (b"", b"\xff\xfe", b"[" * 5000, b"name = 1", b"[[rows]]\n" * 500, b"a" * 100_000)
STRANGE_VALUES = (
    '""', '".."', '"/etc"', '"\\u202e"', "[]", "{}", "[[]]", "1e999", "nan", "-inf", "9" * 400, "true", "1979-05-27",
    '["nvs/psnr", "nvs/psnr"]', '["nvs/"]', "{ a = { b = { c = 1 } } }", '"' + "x" * 5000 + '"', "0x7fffffffffffffff",
)  # fmt: skip


def run() -> int:
    """The command."""
    kind, *given = sys.argv[1:]
    count, seed = (
        int(number or usual) for number, usual in zip_longest(given, (10_000 if kind == "scenes" else 500, 0))
    )
    found = {"scenes": scenes, "suites": suites}[kind](count, seed)
    sys.stdout.write(json.dumps(found, indent=1) + "\n")
    return int(any(found[each] for each in WRONG))


if __name__ == "__main__":
    sys.exit(run())
