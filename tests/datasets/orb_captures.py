"""Captures as Stanford-ORB has them, small and made up."""

import json
import math
from pathlib import Path

import numpy as np

from radiogs_datasets.image_files import write_exr, write_png

ANGLE = 0.6
SIDE = 32


def pose(azimuth: float) -> np.ndarray:
    """OpenGL camera-to-world at distance 3, 30 degrees up, looking at the origin."""
    elevation = math.radians(30)
    back = np.array(
        [math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation)]
    )
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(back, right), back], -1)
    matrix[:3, 3] = 3 * back
    return matrix


def frames(split: str, count: int) -> list[dict[str, object]]:
    return [{"file_path": f"./{split}/{k:04}", "transform_matrix": pose(0.7 * k).tolist()} for k in range(count)]


def write_captures(root: Path) -> Path:
    """Two captures of one object as LDR, with ground truth; the first names the second as novel, and is returned."""
    generator = np.random.default_rng(0)
    for name in ("teapot_scene001", "teapot_scene002"):
        folder, truth = root / "data ü/blender_LDR" / name, root / "data ü/ground_truth" / name
        for split, count in (("train", 3), ("test", 2)):
            for kind in (split, f"{split}_mask"):
                (folder / kind).mkdir(parents=True)
            for k in range(count):
                write_png(folder / f"{split}/{k:04}.png", generator.random((SIDE, SIDE, 3)).astype(np.float32))
                mask = np.zeros((SIDE, SIDE, 1), np.float32)
                mask[8:24, 8:24] = 1
                write_png(folder / f"{split}_mask/{k:04}.png", mask)
            table = {"camera_angle_x": ANGLE, "frames": frames(split, count)}
            (folder / f"transforms_{split}.json").write_text(json.dumps(table))
        for kind in ("env_map", "surface_normal", "z_depth", "pseudo_gt_albedo"):
            (truth / kind).mkdir(parents=True)
        for k in range(2):
            light = np.full((16, 32, 3), 0.01, np.float32)
            light[4, 24] = (8, 4, 2)
            write_exr(truth / f"env_map/{k:04}.exr", light)
            normal = np.tile(np.array([0.0, 0.6, 0.8], np.float32), (SIDE, SIDE, 1))
            np.save(truth / f"surface_normal/{k:04}.npy", normal)
            np.save(truth / f"z_depth/{k:04}.npy", np.full((SIDE, SIDE), 2.5, np.float32))
            write_png(truth / f"pseudo_gt_albedo/{k:04}.png", np.full((SIDE, SIDE, 3), 0.5, np.float32))
    first = root / "data ü/blender_LDR/teapot_scene001"
    novel = [{"scene_name": "teapot_scene002", "camera_angle_x": ANGLE, **frame} for frame in frames("test", 2)]
    novel.append(novel[0] | {"scene_name": "teapot_scene009"})
    (first / "transforms_novel.json").write_text(json.dumps({"frames": novel}))
    return first
