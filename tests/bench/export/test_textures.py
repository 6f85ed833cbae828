"""Textured meshes of two painted balls: other programs find the paint at its place in the files."""

import json
import struct
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import torch
from jaxtyping import Float
from PIL import Image
from torch import Tensor
from torch.nn.functional import grid_sample

from bench.export.depths import all_around, depth_of_sphere
from radiogs_bench.cli.main import main
from radiogs_bench.export.fusion import Lattice
from radiogs_bench.export.mesh import mesh_of
from radiogs_bench.export.mesh_files import write_textured
from radiogs_bench.export.textures import Textured, reduced, textured, unwrapped
from radiogs_core.contract import MapKind, Maps, NotOffered
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_decode
from radiogs_core.scene.scene import View
from radiogs_datasets.blend.process import blender_failure, blender_python
from radiogs_datasets.image_files import read_exr

pytest.importorskip("trimesh")
pytest.importorskip("xatlas")

LATTICE = Lattice(voxel=0.03, truncation=0.12, farthest=10.0)
RADIUS, MIDDLES = 0.5, (torch.tensor([-0.62, 0.0, 0.1]).double(), torch.tensor([0.62, 0.0, -0.1]).double())
PIXEL = 4 / (1.3 * 160)
"""World units across a pixel at the origin."""

VIEWS = [View(f"{place}", camera, {}) for place, camera in enumerate(all_around(24))]
UP = torch.tensor([0.0, 0.0, 1.0])
COVERAGE = 0.8
PAINT = torch.tensor(
    [[0.9, 0.1, 0.05, 0.9], [0.2, 0.6, 0.1, 0.3], [0.02, 0.1, 0.7, 0.6], [0.8, 0.8, 0.75, 0.15]]
).double()
"""Albedo and roughness of both balls' lower and upper parts."""


def above(points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
    """Height above the edge of each ball's paint, world units: its normal is along no axis."""
    return points @ torch.tensor([0.36, 0.48, 0.8]).double() - 0.1


def paint_at(points: Float[Tensor, "*batch 3"], blur: float = 1e-9) -> Float[Tensor, "*batch 4"]:
    """The paint of the ball on this side, linear across ``blur`` world units at its edge."""
    share = (above(points) / blur + 0.5).clamp(0, 1)[..., None]
    ball = 2 * (points[..., 0] > 0).long()
    return torch.lerp(PAINT[ball], PAINT[ball + 1], share)


class PaintedBalls:
    """A prepared model of the balls, with the maps of area-sampled images: an edge takes a pixel."""

    offers: Mapping[str, MapKind] = dict.fromkeys(("image", "alpha", "depth", "albedo", "roughness"), MapKind("data"))
    default = frozenset({"image", "alpha"})
    timed = False

    def render(self, camera: Camera, *further: str) -> Maps:
        exact = camera.to(dtype=torch.float64)
        depths = torch.stack([depth_of_sphere(exact, RADIUS, middle) for middle in MIDDLES])
        depth = torch.where(depths > 0, depths, torch.inf).amin(0)
        alpha = COVERAGE * depth.isfinite()[..., None].double()
        depth = torch.where(depth.isfinite(), depth, 0.0)[..., None]
        paint = alpha * paint_at(exact.centre + depth * exact.ray_directions(), PIXEL)
        maps = {
            "image": paint[..., :3],
            "alpha": alpha,
            "depth": depth,
            "albedo": paint[..., :3],
            "roughness": paint[..., 3:],
        }
        return {name: image.float() for name, image in maps.items() if name in {*self.default, *further}}


@pytest.fixture(scope="module")
def balls() -> Textured:
    mesh = reduced(mesh_of(PaintedBalls(), VIEWS, LATTICE), 3000)
    assert 2000 < len(mesh.faces) <= 3000
    return textured(PaintedBalls(), VIEWS, unwrapped(mesh, PIXEL / 2), LATTICE)


def looked_up(image: Float[Tensor, "height width channels"], uv: Float[Tensor, "points 2"]) -> Tensor:
    """Values between the centres of an image's pixels, in float64; ``uv`` from its upper left corner, of its size."""
    grid = (2 * uv - 1).double()[None, None]
    return grid_sample(image.double().permute(2, 0, 1)[None], grid, padding_mode="border", align_corners=False)[
        0, :, 0
    ].T


@dataclass(frozen=True)
class Read:
    """A file read according to its format; texture coordinates from the upper left corner."""

    points: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    faces: np.ndarray
    images: tuple[Image.Image, Image.Image]

    def paint(self, corners: Float[np.ndarray, "3"]) -> tuple[Float[Tensor, "faces 3"], Float[Tensor, "faces 4"]]:
        """A point of each face in the world, Z up, and the paint there: bilinear, albedo linear."""
        x, y, z = np.einsum("c,fcd->df", corners, self.points[self.faces])
        uv = np.einsum("c,fcd->fd", corners, self.uv[self.faces])
        values = [looked_up(torch.from_numpy(np.array(image)) / 255, torch.from_numpy(uv)) for image in self.images]
        colour, roughness = srgb_decode(values[0].clamp(0, 1)), values[1][:, 1:2]
        return torch.from_numpy(np.stack([x, -z, y], -1)), torch.cat([colour, roughness], -1)


def read_glb(path: Path) -> Read:
    content = path.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    described, binary = json.loads(content[20 : 20 + length]), content[28 + length :]
    assert not {"extensionsUsed", "extensionsRequired"} & set(described)

    def view(number: int) -> bytes:
        place = described["bufferViews"][number]
        return binary[place.get("byteOffset", 0) :][: place["byteLength"]]

    def values(number: int, kind: str) -> np.ndarray:
        return np.frombuffer(view(described["accessors"][number]["bufferView"]), kind)

    (drawn,) = described["meshes"][0]["primitives"]
    material = described["materials"][drawn["material"]]["pbrMetallicRoughness"]
    assert (material["metallicFactor"], material.get("roughnessFactor", 1)) == (0, 1)
    assert material.get("baseColorFactor", [1] * 4) == [1] * 4
    images = [
        described["images"][described["textures"][material[name]["index"]]["source"]]["bufferView"]
        for name in ("baseColorTexture", "metallicRoughnessTexture")
    ]
    colour, roughness = (Image.open(BytesIO(view(number))) for number in images)
    of = drawn["attributes"]
    points, normals, uv = (
        values(of[name], "<f4").reshape(-1, size) for name, size in (("POSITION", 3), ("NORMAL", 3), ("TEXCOORD_0", 2))
    )
    return Read(points, normals, uv, values(drawn["indices"], "<u4").reshape(-1, 3).astype(int), (colour, roughness))


def read_obj(path: Path) -> Read:
    lines = [line.split() for line in path.read_text().splitlines() if line]
    points, normals, uv = (
        np.array([line[1:] for line in lines if line[0] == kind], float) for kind in ("v", "vn", "vt")
    )
    faces = np.array([[corner.split("/") for corner in line[1:]] for line in lines if line[0] == "f"], int) - 1
    assert (faces[..., 0] == faces[..., 1]).all()
    assert (faces[..., 0] == faces[..., 2]).all()
    (materials,) = (line[1] for line in lines if line[0] == "mtllib")
    given = dict(line.split(maxsplit=1) for line in (path.parent / materials).read_text().splitlines())
    assert [line[1] for line in lines if line[0] == "usemtl"] == [given["newmtl"]]
    assert [float(value) for value in (*given["Kd"].split(), given["Pm"])] == [1, 1, 1, 0]
    colour, roughness = (Image.open(path.parent / given[name]).convert("RGB") for name in ("map_Kd", "map_Pr"))
    return Read(points, normals, uv * [1, -1] + [0, 1], faces[..., 0], (colour, roughness))


READERS = {"gltf": ("my balls.glb", read_glb), "obj": ("my balls.obj", read_obj)}


@pytest.mark.parametrize("form", READERS)
def test_a_file_has_the_paint_where_it_is_with_y_up_and_faces_outwards(
    balls: Textured, tmp_path: Path, form: str
) -> None:
    name, reader = READERS[form]
    written = write_textured(balls, form, UP, tmp_path / "new" / name)
    assert {*written} == {*(tmp_path / "new").iterdir()}
    found = reader(written[0])
    for corners in (np.full(3, 1 / 3), np.array([0.98, 0.01, 0.01]), np.array([0.02, 0.49, 0.49])):
        points, paint = found.paint(corners)
        middle = torch.where(points[:, :1] > 0, MIDDLES[1], MIDDLES[0])
        assert (points - middle).norm(dim=-1) == pytest.approx(RADIUS, abs=0.02)
        plain = above(points).abs() > 2 * PIXEL
        assert plain.sum() > 2000
        assert paint[plain] == pytest.approx(paint_at(points[plain]), abs=0.02)
    upright = np.stack([found.normals[:, 0], -found.normals[:, 2], found.normals[:, 1]], -1)
    first, second, third = (torch.from_numpy(found.points[found.faces[:, corner]]) for corner in range(3))
    across = torch.linalg.cross(second - first, third - first)
    outwards = (points - middle) / RADIUS
    assert ((outwards[:, [0, 2, 1]] * torch.tensor([1, 1, -1]) * across).sum(-1) > 0).all()
    assert ((torch.from_numpy(upright[found.faces[:, 0]]) * outwards).sum(-1) > 0.9).all()
    assert np.linalg.norm(found.normals, axis=-1) == pytest.approx(1, abs=1e-4)


def seen_straight(points: Float[Tensor, "points 3"]) -> Float[Tensor, "points 4"]:
    """The paint at points of the balls as the view that faces each best shows it, bilinear between its pixels."""
    outwards = points - torch.where(points[:, :1] > 0, MIDDLES[1], MIDDLES[0])
    towards = torch.stack([view.camera.centre for view in VIEWS])
    best = (outwards @ (towards / towards.norm(dim=-1, keepdim=True)).T).argmax(-1)
    values = torch.zeros(len(points), 4, dtype=torch.float64)
    for number, view in enumerate(VIEWS):
        pixel, _, _ = view.camera.project(points[best == number])
        maps = PaintedBalls().render(view.camera, "albedo", "roughness")
        values[best == number] = looked_up(torch.cat([maps["albedo"], maps["roughness"]], -1), pixel / 160) / COVERAGE
    return values


def width_of_edge(points: Float[Tensor, "points 3"], paint: Float[Tensor, "points 4"]) -> float:
    """World units between a tenth and nine tenths of the way from one roughness to the other."""
    ball = 2 * (points[:, 0] > 0).long()
    share = ((paint - PAINT[ball]) / (PAINT[ball + 1] - PAINT[ball]))[:, 3]
    low, high = (float(above(points)[(share - level).abs() < 0.05].median()) for level in (0.1, 0.9))
    return high - low


def test_an_edge_of_paint_is_as_sharp_as_the_best_view_has_it(balls: Textured, tmp_path: Path) -> None:
    found = read_glb(write_textured(balls, "gltf", UP, tmp_path / "a.glb")[0])
    looked = [found.paint(corners) for corners in np.random.default_rng(0).dirichlet(np.ones(3), 30)]
    points, paint = (torch.cat(each) for each in zip(*looked, strict=True))
    assert PIXEL < width_of_edge(points, paint) < 1.15 * width_of_edge(points, seen_straight(points))


class NoRoughness(PaintedBalls):
    offers: Mapping[str, MapKind] = dict.fromkeys(("image", "alpha", "depth", "albedo"), MapKind("data"))


def test_a_model_without_roughness_is_refused(balls: Textured) -> None:
    with pytest.raises(NotOffered, match="renders no roughness"):
        textured(NoRoughness(), VIEWS, balls.shape, LATTICE)


@pytest.mark.parametrize(
    ("options", "missing", "complaint"),
    [
        (["--to", "gltf"], "xatlas", "pip install 'radiogs-bench[mesh]'"),
        (["--mesh", "--to", "obj"], "trimesh", "pip install 'radiogs-bench[mesh]'"),
        (["--to", "gltf", "--out", "a.obj"], "", "--out a.glb"),
        (["--mesh", "--to", "csv"], "", "ask for two files"),
    ],
)
def test_unwritable_output_is_refused_before_anything_is_read(
    options: list[str],
    missing: str,
    complaint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if missing:
        monkeypatch.setitem(sys.modules, missing, None)
    assert main(["export", str(tmp_path), *options]) == 2
    assert complaint in capsys.readouterr().err


IN_BLENDER = """
import sys, json, bpy
from mathutils import Matrix
path, place, pose, lens, size = json.loads(sys.argv[1])
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=path)
scene = bpy.context.scene
scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
scene.collection.objects.link(scene.camera)
scene.camera.matrix_world = Matrix(pose)
scene.camera.data.lens = lens * scene.camera.data.sensor_width
scene.render.engine, scene.cycles.samples, scene.cycles.max_bounces = "CYCLES", 1, 0
scene.cycles.use_denoising = False
scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BLACKMAN_HARRIS", 0.01
scene.render.resolution_x = scene.render.resolution_y = size
scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
(material,) = bpy.data.materials
tree = material.node_tree
(shader,) = (node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
(output,) = (node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
emission = tree.nodes.new("ShaderNodeEmission")
tree.links.new(emission.outputs[0], output.inputs["Surface"])
for name in ("Base Color", "Roughness"):
    tree.links.new(shader.inputs[name].links[0].from_socket, emission.inputs["Color"])
    scene.render.filepath = f"{place}/{name}.exr"
    bpy.ops.render.render(write_still=True)
"""


@pytest.mark.slow
def test_blender_shows_the_paint_to_the_cameras_of_the_scene(balls: Textured, tmp_path: Path) -> None:
    failure = blender_failure()
    if failure is not None:
        pytest.skip(f"Blender cannot be used here: {failure}")
    (path,) = write_textured(balls, "gltf", UP, tmp_path / "balls.glb")
    camera = VIEWS[7].camera
    pose = camera.camera_to_world * torch.tensor([1.0, -1.0, -1.0, 1.0])
    asked = json.dumps([str(path), str(tmp_path), pose.tolist(), camera.fx / camera.width, camera.width])
    done = subprocess.run([blender_python(), "-W", "ignore", "-c", IN_BLENDER, asked], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    shown = [read_exr(tmp_path / f"{name}.exr")[..., :3] for name in ("Base Color", "Roughness")]
    maps = PaintedBalls().render(camera, "albedo", "roughness", "depth")
    points = (camera.centre + maps["depth"].double() * camera.ray_directions())[maps["alpha"][..., 0] > 0]
    middle = torch.where(points[:, :1] > 0, MIDDLES[1], MIDDLES[0])
    towards = camera.centre - points
    facing = ((points - middle) * towards).sum(-1) / RADIUS / towards.norm(dim=-1)
    plain = (above(points).abs() > 3 * PIXEL) & (facing > 0.3)
    assert plain.sum() > 1000
    found = np.concatenate([shown[0], shown[1][..., :1]], -1)[(maps["alpha"][..., 0] > 0).numpy()]
    assert found[plain.numpy()] == pytest.approx(paint_at(points[plain]).numpy(), abs=0.02)
