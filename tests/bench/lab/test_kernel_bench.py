"""The kernel bench: its scenes, yardsticks that compute the same, and the command."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from radiogs_bench.cli import main
from radiogs_bench.lab.kernels.bench import SCHEMA, MeasuredPass, as_table, measure
from radiogs_bench.lab.kernels.cases import rasterize_case, shade_case, square_camera, trace_case
from radiogs_bench.lab.kernels.embree import missing_embree, support_quads
from radiogs_bench.lab.kernels.plain import rasterize_densely, shade_plainly
from radiogs_bench.lab.kernels.scenes import SCENES, KernelScene, cloud
from radiogs_core.errors import DataError
from radiogs_core.instruments import recording
from radiogs_core.kernels.rasterize.rasterize import rasterize
from radiogs_core.kernels.shade.shade import shade
from radiogs_core.kernels.surfel.geometry import SplatGeometry
from radiogs_core.kernels.trace.bvh import SurfelBVH
from radiogs_core.kernels.trace.trace import Hits, trace

CPU = torch.device("cpu")


def some_rays(name: str, count: int) -> KernelScene:
    scene = SCENES[name]()
    return replace(scene, origin=scene.origin[:count], direction=scene.direction[:count], t_min=scene.t_min[:count])


def traced(scene: KernelScene) -> Hits:
    tree = SurfelBVH.build(scene.geometry)
    return trace(tree, scene.geometry, scene.sh, scene.features, scene.origin, scene.direction, scene.t_min)


@pytest.mark.parametrize(("name", "meet", "hits"), [("M", 0.42, 5.0), ("Mi", 1.0, 15.0)])
def test_scenes_have_the_hits_that_they_state(name: str, meet: float, hits: float) -> None:
    scene = some_rays(name, 20_000)
    with recording() as instruments:
        found = traced(scene)
    assert float((found.transmittance < 1).float().mean()) == pytest.approx(meet, abs=0.02)
    assert instruments.work["hits"] / 20_000 == pytest.approx(hits, rel=0.1)


def test_the_yardstick_s_quads_cover_each_surfel_to_its_threshold() -> None:
    geometry = SCENES["S"]().geometry
    corners, triangles = support_quads(geometry)
    assert triangles.shape == (2 * len(geometry), 3)
    offset = corners.view(-1, 4, 3) - geometry.centre[:, None]
    u, v = (offset * geometry.axis_u[:, None]).sum(-1), (offset * geometry.axis_v[:, None]).sum(-1)
    reach = (2 * (255 * geometry.opacity).log()).sqrt()
    for place, (sign_u, sign_v) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
        torch.testing.assert_close(u[:, place], sign_u * reach, rtol=1e-4, atol=1e-4)
        torch.testing.assert_close(v[:, place], sign_v * reach, rtol=1e-4, atol=1e-4)


@pytest.mark.skipif(missing_embree() != "", reason=missing_embree())
def test_embree_meets_something_where_the_kernel_does() -> None:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = some_rays("M", 20_000)
    corners, triangles = support_quads(scene.geometry)
    embree = EmbreeScene()
    TriangleMesh(embree, corners.numpy(), triangles.numpy())
    start = scene.origin + scene.t_min[:, None] * scene.direction
    met = torch.from_numpy(embree.run(start.numpy(), scene.direction.numpy()) >= 0)
    ours = traced(scene).transmittance < 1
    assert not (ours & ~met).any(), "the quads hold the supports"
    assert float((met & ~ours).float().mean()) < 0.25, "it also meets back sides and the corners of quads"


def test_the_dense_rasterizer_agrees_with_the_kernel() -> None:
    generator = torch.Generator().manual_seed(0)
    scene = SCENES["S"]()
    some = torch.randperm(len(scene.geometry), generator=generator)[:300]
    fields = (getattr(scene.geometry, name) for name in ("centre", "axis_u", "axis_v", "normal", "opacity"))
    geometry = SplatGeometry(*(value[some].double() for value in fields))
    features = torch.rand(300, 3, generator=generator, dtype=torch.float64)
    camera = square_camera(24)
    ours = rasterize(camera, geometry, features, 1.0).features.view(-1, 3)
    # The kernel stops at pixels of which less than 1e-4 is left; the dense sum does not.
    torch.testing.assert_close(rasterize_densely(camera, geometry, features), ours, rtol=0, atol=2e-4)
    assert ours.max() > 0.1


def test_the_plain_expression_agrees_with_the_shading_kernel() -> None:
    generator = torch.Generator().manual_seed(0)

    def unit(*shape: int) -> torch.Tensor:
        return torch.nn.functional.normalize(torch.randn(*shape, generator=generator, dtype=torch.float64), dim=-1)

    def uniform(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    given = (
        unit(20, 3), uniform(20, 3), 0.1 + 0.9 * uniform(20), unit(20, 2, 3), unit(20, 9, 3), uniform(20, 9),
        uniform(20, 9), uniform(20, 9, 3), uniform(8, 16, 3),
    )  # fmt: skip
    torch.testing.assert_close(shade_plainly(*given), shade(*given), rtol=1e-9, atol=1e-12)


def test_points_of_a_file_become_a_scene(tmp_path: Path) -> None:
    file = tmp_path / "points.npz"
    np.savez(file, means3d=np.random.default_rng(0).normal(size=(500, 3)).astype(np.float32))
    scene = cloud(file)
    assert len(scene.geometry) == 500
    assert all(bool(torch.isfinite(getattr(scene.geometry, name)).all()) for name in ("centre", "axis_u", "axis_v"))
    assert (scene.geometry.normal[:, 2] >= 0).all()


@pytest.mark.parametrize("content", [b"", b"no archive"])
def test_a_file_without_points_is_an_error(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / "points.npz"
    file.write_bytes(content)
    with pytest.raises(DataError, match="cannot read points"):
        cloud(file)


@pytest.mark.slow
def test_kernels_that_count_no_bytes_have_a_row_all_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    """Audit K: the command, at its default, measured for minutes and ended in ``KeyError: 'bytes_read'``."""
    counting = {"hits": 3.0, "bytes_read": 2048.0}
    row = MeasuredPass("trace", "M", "float32", "forward", 1, "ray", 1.0, 0, counting, None, None, None)
    rows = [row, replace(row, counters={})]
    table = as_table(rows, on_gpu=False)
    (column,) = [each for each in table.columns if each.header == "KiB read an item"]
    assert list(column.cells) == ["2.00", ""]
    assert main(["bench", "kernels", "--kernels", "harmonics,split-sum", "--repetitions", "1"]) == 0
    assert "split-sum" in capsys.readouterr().out


@pytest.mark.slow
def test_the_command_writes_its_measurements(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = tmp_path / "kernels.json"
    assert main(["bench", "kernels", "--kernels", "shade", "--repetitions", "1", "--json", str(record)]) == 0
    content = json.loads(record.read_text())
    assert content["schema"] == "radiogs-bench/kernels/1"
    assert [(row["dtype"], row["direction"]) for row in content["rows"]] == [
        (dtype, direction) for dtype in ("float32", "float64") for direction in ("forward", "backward", "both")
    ]
    assert all(row["ratio"] > 0 and row["yardstick"] == "plain PyTorch" for row in content["rows"])
    assert content["machine"]["cpu"]
    assert "shade" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("wrong", "said"), [(["--kernels", "paint"], "unknown kernel 'paint'"), (["--scenes", "S,X"], "unknown scene 'X'")]
)
def test_unknown_kernels_and_scenes_are_refused(
    wrong: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "kernels", *wrong]) == 2
    assert said in capsys.readouterr().err


def test_the_document_has_the_stored_values() -> None:
    documents = Path(__file__).parents[3] / "docs"
    text = (documents / "cost.md").read_text(encoding="utf-8")
    stored = json.loads((documents / "performance" / "kernels.json").read_text())
    assert stored["schema"] == SCHEMA
    for row in stored["rows"]:
        (line,) = re.findall(rf"^\| {row['kernel']} \| {re.escape(row['scene'])} \|.*$", text, re.MULTILINE)
        if row["dtype"] == "float64":
            continue
        assert f"{row['millions_per_second']:.3g}" in line
        assert row["ratio"] is None or f"{row['ratio']:.2f}" in line


@pytest.mark.slow
@pytest.mark.alone
@pytest.mark.skipif(missing_embree() != "", reason=missing_embree())
def test_tracing_keeps_up_with_embree() -> None:
    forward, backward, _ = measure(trace_case(SCENES["M"](), torch.float32, CPU), CPU, 3)
    assert forward.ratio is not None
    assert backward.ratio is not None
    assert forward.ratio > 0.5
    assert backward.ratio > 0.25


@pytest.mark.slow
@pytest.mark.alone
def test_rasterizing_and_shading_leave_plain_expressions_behind() -> None:
    *_, both = measure(rasterize_case(SCENES["S"](), 128, torch.float32, CPU, dense=True), CPU, 1)
    assert both.ratio is not None
    assert both.ratio > 50
    *_, both = measure(shade_case(torch.float32, CPU), CPU, 3)
    assert both.ratio is not None
    assert both.yardstick_peak_bytes is not None
    assert both.ratio > 3
    assert both.peak_bytes * 8 < both.yardstick_peak_bytes
