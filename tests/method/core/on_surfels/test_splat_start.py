"""Stage 1 starts from files of splats by 3DGS, 2DGS and gsplat, and refuses other files."""

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement
from scipy.spatial.transform import Rotation

from radiogs_core.contract import Run
from radiogs_core.errors import DataError, UsageError
from radiogs_core.learning.geometry import GeometryLearning
from radiogs_core.on_surfels.fit_geometry import fit_geometry
from radiogs_core.on_surfels.splat_start import read_splats, splat_surfels
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.starting_points import SurfelStart
from short_training import BUDGET, CPU, SCENE

PLACE, NORMALS, SPAN = ("x", "y", "z"), ("nx", "ny", "nz"), ("scale_0", "scale_1", "scale_2")
TURN, THIN = tuple(f"rot_{index}" for index in range(4)), 0.005


def harmonics(coefficients: int) -> tuple[str, ...]:
    return (*(f"f_dc_{channel}" for channel in range(3)), *(f"f_rest_{index}" for index in range(3 * coefficients - 3)))


WRITERS: Mapping[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "3dgs": ((*PLACE, *NORMALS, *harmonics(16), "opacity", *SPAN, *TURN), {"byte_order": "<"}),
    "2dgs": ((*PLACE, *NORMALS, *harmonics(16), "opacity", *SPAN[:2], *TURN), {"byte_order": "<"}),
    "gsplat": ((*PLACE, *harmonics(9), "opacity", *SPAN, *TURN), {"byte_order": "<"}),
    "gsplat, no rest": ((*PLACE, *harmonics(1), "opacity", *SPAN, *TURN), {"byte_order": ">"}),
    "in text, and more": (("segment", *PLACE, *harmonics(4), "opacity", *SPAN, *TURN, "red"), {"text": True}),
}
"""Properties in the order of ``save_ply`` (3DGS and 2DGS, scene/gaussian_model.py) and ``splat2ply_bytes`` (gsplat)."""


def write(path: Path, columns: Mapping[str, Any], **form: Any) -> SurfelStart:
    """A file of these properties, in this order; returns the start from it."""
    count = len(next(iter(columns.values())))
    rows = np.zeros(count, [(name, "f4") for name in columns])
    for name, values in columns.items():
        rows[name] = values
    PlyData([PlyElement.describe(rows, "vertex")], **form).write(str(path))
    return SurfelStart(splat=str(path), splat_sha256=hashlib.sha256(path.read_bytes()).hexdigest())


def on_the_sphere(names: tuple[str, ...], count: int = 1000) -> tuple[dict[str, Any], NDArray]:
    """Ellipsoids on the sphere of ``SCENE``, opaque, in its colours and thinnest along its normals; and the normals.

    The thin axis is any of the three, of either sign, and quaternions have any length.
    """
    draw = np.random.default_rng(0)
    normals = draw.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    thin = draw.integers(3, size=count) if "scale_2" in names else np.full(count, 2)
    scales, turns = np.zeros((count, 3)), np.zeros((count, 4))
    for index, normal in enumerate(normals):
        frame = np.roll(np.linalg.qr(np.stack([normal, *draw.normal(size=(2, 3))], -1))[0], thin[index], axis=1)
        turns[index] = Rotation.from_matrix(frame * np.linalg.det(frame)).as_quat(scalar_first=True)
        scales[index] = np.roll([THIN, 0.05, 0.1], thin[index])
    turns *= draw.uniform(0.1, 9, (count, 1))
    found = {**dict(zip(PLACE, normals.T, strict=True)), **dict(zip(TURN, turns.T, strict=True))}
    found |= {"opacity": np.full(count, math.log(99)), **dict(zip(SPAN, np.log(scales).T, strict=True))}
    found |= {f"f_dc_{axis}": 0.4 * normals[:, axis] * math.sqrt(4 * math.pi) for axis in range(3)}
    return {name: found.get(name, np.zeros(count)) for name in names}, normals


def stacked(columns: Mapping[str, Any], names: tuple[str, ...]) -> NDArray:
    return np.stack([columns[name] for name in names], -1)


@pytest.mark.parametrize("writer", WRITERS)
def test_a_known_ellipsoid_becomes_the_right_surfel(writer: str, tmp_path: Path) -> None:
    """Its covariance is the ellipsoid's; its normal is the thinnest axis, turned to the cameras that see it."""
    names, form = WRITERS[writer]
    columns, normals = on_the_sphere(names)
    surfels = splat_surfels(write(tmp_path / "s.ply", columns, **form), [view.camera for view in SCENE.train], False)
    np.testing.assert_array_equal(surfels.centre, stacked(columns, PLACE).astype("f4"))
    np.testing.assert_allclose(surfels.opacity, 0.99, rtol=1e-5)
    axes = Rotation.from_quat(stacked(columns, TURN), scalar_first=True).as_matrix()
    scales = np.exp(np.stack([columns.get(name, np.full(len(normals), math.log(THIN))) for name in SPAN], -1))
    frame = surfels.frame.double().numpy()
    scaled = np.concatenate([surfels.scale.double().numpy(), np.full((len(normals), 1), THIN)], 1)
    found, true = frame * scaled[:, None], axes * scales[:, None]
    np.testing.assert_allclose(found @ found.transpose(0, 2, 1), true @ true.transpose(0, 2, 1), atol=1e-6)
    cosine = [(view.camera.centre.numpy() - normals) / 4 * normals for view in SCENE.train]
    faced = np.sum(cosine, axis=-1).max(0) > 0.5
    assert ((frame[..., 2] * normals).sum(-1)[faced] > 0.99).all()


def test_harmonics_are_read_channel_by_channel_and_become_linear(tmp_path: Path) -> None:
    """Degree 1 in 3DGS: C1 (-y, z, -x) along the direction of travel; a surfel of one colour becomes linear exactly."""
    columns, _ = on_the_sphere(WRITERS["in text, and more"][0], 1)
    values = np.linspace(-0.2, 0.3, 12)
    start = write(tmp_path / "s.ply", columns | dict(zip(harmonics(4), values[:, None], strict=True)))
    x, y, z = (along := torch.tensor([0.48, -0.6, 0.64]))
    expected = [
        0.5 + 0.28209479 * values[c] + 0.48860251 * (values[3 + 3 * c : 6 + 3 * c] @ [-y, z, -x]) for c in range(3)
    ]
    shown = surfel_radiance(read_splats(Path(start.splat), start.splat_sha256).sh, -along[None])
    np.testing.assert_allclose(shown[0], expected, rtol=1e-5)
    flat = columns | {f"f_dc_{channel}": 0.0 for channel in range(3)}
    linear = splat_surfels(write(tmp_path / "s.ply", flat), [view.camera for view in SCENE.train], True)
    np.testing.assert_allclose(surfel_radiance(linear.sh, along[None]), 0.21404114, rtol=1e-4)


def test_a_stage_that_starts_from_good_splats_begins_with_a_lower_loss_and_in_its_middle(tmp_path: Path) -> None:
    start = write(tmp_path / "s.ply", on_the_sphere(WRITERS["3dgs"][0])[0])

    def begun(start: SurfelStart) -> Any:
        return fit_geometry(GeometryLearning(start=start), BUDGET.geometry).begin(Run(SCENE, None, None, 0, CPU), {})

    losses = [sum(begun(each).step().values()) for each in (SurfelStart(), replace(start, splat_skips=0.0))]
    assert losses[1] < 0.85 * losses[0]
    half, all_left_out = begun(start), begun(replace(start, splat_skips=1.0))
    assert (half.iteration, all_left_out.iteration) == (12, half.iterations)
    assert len(half.surfels) == 1000, "all are taken, whatever the budget's first number"


def changed(**columns: Any) -> Callable[[Path], SurfelStart]:
    return lambda path: write(path, on_the_sphere(WRITERS["3dgs"][0], 3)[0] | columns)


def mostly_elsewhere(path: Path) -> SurfelStart:
    columns = on_the_sphere(WRITERS["3dgs"][0], 100)[0]
    return write(path, columns | {"x": np.where(np.arange(100) < 20, columns["x"], 1e4)})


def truncated(path: Path) -> SurfelStart:
    write(path, on_the_sphere(WRITERS["3dgs"][0], 3)[0])
    path.write_bytes(path.read_bytes()[:-9])
    return SurfelStart(splat=str(path), splat_sha256=hashlib.sha256(path.read_bytes()).hexdigest())


REFUSED: Mapping[str, tuple[Callable[[Path], SurfelStart], str]] = {
    "a mesh": (
        lambda path: write(path, dict.fromkeys((*PLACE, *NORMALS), np.ones(3))),
        "no splats: it has vertex: x, y",
    ),
    "NaN": (changed(opacity=[0, np.nan, 0]), "holds 1 values of opacity .* of 3 splats"),
    "a scale beyond float32": (changed(scale_1=[0, 0, 99]), r"1 values of scale_\*"),
    "no rotation": (changed(**dict.fromkeys(TURN, np.zeros(3))), r"3 values of rot_\*"),
    "none": (lambda path: write(path, dict.fromkeys(WRITERS["3dgs"][0], np.zeros(0))), "'vertex' is empty"),
    "degree 4": (changed(**dict.fromkeys(harmonics(25), 0.0)), "72 properties f_rest"),
    "a gap in the names": (changed(f_rest_99=0.0), "cannot read .*f_rest_45"),
    "another world": (changed(x=np.full(3, 1e4)), r"training views see 0 of the 3 splats .*\n.*\(1e\+04,"),
    "another world, all but a fifth": (mostly_elsewhere, r"training views see [1-9]\d of the 100 splats"),
    "a truncated file": (truncated, "cannot read"),
    "another file": (lambda path: replace(changed()(path), splat_sha256="0" * 64), "has changed since"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_file_without_usable_splats_is_refused_in_three_parts(case: str, tmp_path: Path) -> None:
    make, message = REFUSED[case]
    with pytest.raises(DataError, match=message) as refusal:
        splat_surfels(make(tmp_path / "s.ply"), [view.camera for view in SCENE.train], linear=True)
    assert str(tmp_path / "s.ply") in refusal.value.what
    assert all((refusal.value.why, refusal.value.remedy))


def test_a_file_is_not_named_without_its_checksum() -> None:
    with pytest.raises(UsageError, match="one needs the other"):
        SurfelStart(splat="s.ply")
