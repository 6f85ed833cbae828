"""Sound captures, changed at random in names, splits, sizes, modes and poses: read as they were made, or refused.

The truth comes from the generator alone: the colour of a photo encodes its view, and its camera's place is a function
of the view.
"""

import json
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene

VIEWS, SIDE, FOCAL = 12, 24, 30.0


def pose_of(view: int) -> np.ndarray:
    """Camera-to-world of a view, OpenCV axes: on a ring of radius 3, looking at its middle."""
    angle = 2 * np.pi * view / VIEWS
    place = 3 * np.array([np.cos(angle), np.sin(angle), 0.3 + 0.02 * view])
    forward = -place / np.linalg.norm(place)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(forward, right), forward, place], -1)
    return pose


def photo_of(view: int) -> np.ndarray:
    return np.full((SIDE, SIDE, 3), 40 + 16 * view, np.uint8)


@dataclass
class Capture:
    """Names by view, in the table of poses and in the folder, and what else is written."""

    table: dict[int, str]
    files: dict[int, str]
    poses: dict[int, np.ndarray]
    photos: dict[int, np.ndarray]
    lists: dict[str, list[int]] = field(default_factory=dict)
    doubtful: set[int] = field(default_factory=set)
    """Views whose pose is wrong, which no name can tell."""


def sound(ending: str) -> Capture:
    names = {view: f"frame_{view + 1:04}{ending}" for view in range(VIEWS)}
    poses = {view: pose_of(view) for view in range(VIEWS)}
    return Capture({**names}, {**names}, poses, {view: photo_of(view) for view in range(VIEWS)})


def mutate(kind: str, capture: Capture, random: Random) -> None:
    side = random.choice((capture.table, capture.files))
    one = random.choice(sorted(capture.table))
    match kind:
        case "zeros":
            side |= {view: name.replace(f"{view + 1:04}", str(view + 1)) for view, name in side.items()}
        case "ending":
            ending = random.choice((".HEIC", ".JPG", ".dng", ".jpeg", ".PNG"))
            capture.table = {view: str(Path(name).with_suffix(ending)) for view, name in capture.table.items()}
        case "case":
            side |= {view: name.upper() for view, name in side.items()}
        case "word":
            side |= {view: name.replace("frame_", "IMG_") for view, name in side.items()}
        case "shift":
            by = random.choice((1, 100))
            side |= {view: f"DSC_{view + 1 + by:04}{Path(name).suffix}" for view, name in side.items()}
        case "renumber":
            side |= {view: f"{view:05}{Path(name).suffix}" for view, name in side.items()}
        case "unposed":
            del capture.table[one]
        case "lost":
            capture.files.pop(one, None)
        case "list":
            capture.lists = {random.choice(("test.txt", "test_list.txt")): random.sample(sorted(capture.table), 3)}
        case "lists overlap":
            capture.lists = {"test_list.txt": [0, 1, 2], "train_list.txt": list(range(2, VIEWS))}
        case "size":
            capture.photos = {view: cv2.resize(photo, (SIDE // 2, SIDE // 2)) for view, photo in capture.photos.items()}
        case "far":
            capture.poses[one][:3, 3] *= random.choice((12, 30, 300, 1e5))
            capture.doubtful.add(one)
        case "transposed":
            capture.poses[one] = capture.poses[one].T.copy()
            capture.doubtful.add(one)
        case "mirrored":
            capture.poses[one] = capture.poses[one] * [-1, 1, 1, 1]
            capture.doubtful.add(one)


KINDS = (
    "zeros", "ending", "case", "word", "shift", "renumber", "unposed", "lost", "list", "lists overlap", "size",
    "far", "transposed", "mirrored",
)  # fmt: skip
OF_MATRICES = {"transposed", "mirrored"}
"""Changes that a quaternion cannot hold."""

HARMLESS = {"zeros", "ending", "case", "unposed", "list"}
"""Changes, one at a time, after which names still tell the views apart."""


def write(folder: Path, capture: Capture, layout: str) -> None:
    (folder / "images").mkdir(parents=True)
    for view, name in capture.files.items():
        data = cv2.imencode(Path(name).suffix.lower(), capture.photos[view])[1]
        (folder / "images" / name).write_bytes(data.tobytes())
    for name, views in capture.lists.items():
        (folder / name).write_text("".join(f"{capture.table.get(view, 'none')}\n" for view in views))
    if layout == "transforms":
        frames = []
        for view, name in capture.table.items():
            rows = (capture.poses[view] * [1, -1, -1, 1]).tolist()
            frames.append({"file_path": f"images/{name}", "transform_matrix": rows})
        lens = {"camera_angle_x": 2 * float(np.arctan(SIDE / 2 / FOCAL))}
        (folder / "transforms.json").write_text(json.dumps({**lens, "frames": frames}))
        return
    (folder / "sparse").mkdir()
    (folder / "sparse/cameras.txt").write_text(f"1 PINHOLE {SIDE} {SIDE} {FOCAL} {FOCAL} {SIDE / 2} {SIDE / 2}\n")
    (folder / "sparse/points3D.txt").write_text("")
    lines = []
    for view, name in capture.table.items():
        turn = capture.poses[view][:3, :3].T
        x, y, z, w = Rotation.from_matrix(turn).as_quat()
        shift = -turn @ capture.poses[view][:3, 3]
        lines.append(" ".join(map(str, (view + 1, w, x, y, z, *shift, 1, name))) + "\n\n")
    (folder / "sparse/images.txt").write_text("".join(lines))


def as_made(scene: Scene, capture: Capture) -> bool:
    """Whether each image has the camera of its view, and the listed views are scored."""
    scored = set()
    for view in (*scene.train, *scene.test):
        image = view.read("image")
        shown = round((255 * float(image.mean()) - 40) / 16)
        away = np.abs(view.camera.centre.numpy() - pose_of(shown)[:3, 3]).max()
        focal = FOCAL * image.shape[1] / SIDE
        if away > 1e-3 or abs(view.camera.fx - focal) > 1e-3 or view.camera.width != image.shape[1]:
            return False
        scored |= {shown} if view in scene.test else set()
    listed = {
        view for views in capture.lists.values() for view in views if view in capture.table and view in capture.files
    }
    return not listed or scored == listed


def outcome(folder: Path, capture: Capture) -> str:
    try:
        scene = load_scene(str(folder))
    except DataError as error:
        return "refused" if error.why and error.remedy else f"refused without a reason or remedy: {error}"
    right = as_made(scene, capture)
    named = any(f"frame_{view + 1:04}" in said for view in capture.doubtful for said in scene.repairs)
    return "read right" if right else "warned" if named else "silently wrong"


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["colmap", "transforms"])
def test_none_of_200_mutations_is_silently_wrong(layout: str, tmp_path: Path) -> None:
    random, counts, wrong = Random(82), Counter[str](), []
    for place in range(200):
        capture = sound(random.choice((".png", ".png", ".jpg")))
        kinds = random.sample(
            [kind for kind in KINDS if layout == "transforms" or kind not in OF_MATRICES], random.choice((1, 1, 2, 3))
        )
        for kind in kinds:
            mutate(kind, capture, random)
        folder = tmp_path / f"{layout}_{place}"
        write(folder, capture, layout)
        found = outcome(folder, capture)
        counts[found] += 1
        if found not in ("read right", "refused", "warned") or (
            len(kinds) == 1 and {*kinds} <= HARMLESS and found != "read right"
        ):
            wrong.append(f"{place} {kinds}: {found}")
    assert not wrong, wrong
    assert min(counts["read right"], counts["refused"]) > 30, counts


def test_the_generators_own_scene_is_read_right_and_a_swap_is_seen(tmp_path: Path) -> None:
    for layout in ("colmap", "transforms"):
        capture = sound(".png")
        write(tmp_path / layout, capture, layout)
        assert outcome(tmp_path / layout, capture) == "read right"
        capture.files[2], capture.files[3] = capture.files[3], capture.files[2]
        write(tmp_path / f"{layout}_swapped", capture, layout)
        assert outcome(tmp_path / f"{layout}_swapped", capture) == "silently wrong"
