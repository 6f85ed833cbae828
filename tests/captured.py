"""A miniature as somebody would bring it: photos before a grey wall, masks beside them, and COLMAP's poses."""

from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from radiogs_datasets import load_scene

WALL = 0.35
"""Display sRGB of the background."""


TURNS = {
    "Z up": np.eye(3),
    "Y down": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "Y up": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "X up": np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    "tilted": Rotation.from_rotvec([0.0, np.radians(35), 0.0]).as_matrix(),
}
"""Rotations of a world with Z up, each by the shortest turn, by where they put its upward direction."""


def write_capture(folder: Path, name: str = "corner", every: int = 2, world: str = "Z up") -> Path:
    """Photos of a miniature's training views in ``folder``/images, ``folder``/masks, and a model in text.

    ``every``: one view out of so many. ``world``: a key of TURNS. Returns the folder.
    """
    views = load_scene(name).train[::every]
    for part in ("images", "masks", "sparse/0"):
        (folder / part).mkdir(parents=True)
    cameras, poses = [], []
    for number, view in enumerate(views, start=1):
        camera, file = view.camera, f"photo_{number:03d}.png"
        colour, mask = view.read("image").numpy(), view.read("alpha").numpy()
        photo = colour * mask + WALL * (1 - mask)
        cv2.imwrite(str(folder / "images" / file), _bytes(photo)[..., ::-1])
        cv2.imwrite(str(folder / "masks" / file), _bytes(mask))
        turn = camera.axes.T.numpy().astype(float) @ TURNS[world].T
        shift = -camera.axes.T.numpy().astype(float) @ camera.centre.numpy().astype(float)
        x, y, z, w = Rotation.from_matrix(turn).as_quat()
        size = f"{camera.width} {camera.height} {camera.fx} {camera.fy} {camera.cx} {camera.cy}"
        cameras.append(f"{number} PINHOLE {size}\n")
        poses.append(" ".join(map(str, (number, w, x, y, z, *shift, number, file))) + "\n\n")
    model = folder / "sparse" / "0"
    (model / "cameras.txt").write_text("".join(cameras))
    (model / "images.txt").write_text("".join(poses))
    (model / "points3D.txt").write_text("")
    return folder


def _bytes(values: np.ndarray) -> np.ndarray:
    return np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)
