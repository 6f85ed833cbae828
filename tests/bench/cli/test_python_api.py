"""The Python API, by the walk of docs/start.md as it stands there."""

import pydoc
import re
from collections.abc import Callable
from operator import methodcaller
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

import radiogs_bench as rb
from bench.chain_method import Chain, ChainPrepared, ChainTrained, Turned
from radiogs.showing import TrainedRadioGS
from radiogs_bench import api, whole_runs
from radiogs_bench.cli import main
from radiogs_core.contract import Run
from radiogs_core.errors import DataError, UsageError
from scenes import sphere_scene

PAGE = Path(__file__).parents[3] / "docs" / "start.md"
WALK = PAGE.read_text().split("\n## From Python\n", 1)[1]


@pytest.mark.slow
def test_the_examples_of_the_python_api_run_unchanged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", WALK, flags=re.DOTALL)
    names: dict[str, object] = {}
    capsys.readouterr()
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)
    said = capsys.readouterr().out
    assert "corner 48 training views" in said
    assert "no-rad" in said
    assert (tmp_path / "out" / "no-rad" / "surfels.ply").exists()
    again = rb.train("radiogs", "corner", preset="smoke", variant={"radiometric_weight": 0.0}, out="out/no-rad")
    kept = names["kept"]
    assert isinstance(kept, api.Model)
    assert isinstance(kept.trained, TrainedRadioGS)
    assert isinstance(again.trained, TrainedRadioGS)
    others = again.trained.model.surfels.parameters()
    for name, value in kept.trained.model.surfels.parameters().items():
        assert torch.equal(value, others[name])


def test_every_public_name_is_there_and_documented() -> None:
    assert {*api.__all__, *whole_runs.__all__} == set(rb.__all__) - {"__version__"}
    for module in (api, whole_runs):
        for name in module.__all__:
            assert getattr(rb, name) is getattr(module, name)
            assert f"rb.{name}" in WALK


def test_completion_and_help_list_the_names() -> None:
    assert dir(rb) == sorted(rb.__all__)
    listed = pydoc.render_doc(rb, renderer=pydoc.plaintext)
    assert all(name in listed for name in rb.__all__ if not name.startswith("__"))


@pytest.fixture
def chain_model() -> rb.Model:
    scene = sphere_scene(views=2, size=16)
    run = Run(scene, Turned(), Chain.presets["smoke"], 3, torch.device("cpu"))
    return rb.Model(ChainTrained(torch.zeros(1), 1.0), run, "chain")


def test_a_scene_is_one_line_in_words() -> None:
    scene = rb.load_scene("convex")
    assert repr(scene) == f"Scene(name='convex', layout='tensoir', folder={scene.folder!r}, options={{}})"


def test_a_model_is_short_in_words_and_a_picture_in_a_notebook(chain_model: rb.Model) -> None:
    assert repr(chain_model) == "Model('chain', scene 'sphere', preset 'smoke', seed 3)"
    assert repr(chain_model.prepared()) == "PreparedModel(scene 'sphere', maps image, alpha)"
    picture = cv2.imdecode(np.frombuffer(methodcaller("_repr_png_")(chain_model), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape == (16, 16, 3)
    assert set(picture.flatten()) == {128}


def test_views_and_lights_are_given_by_name_too(chain_model: rb.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = chain_model.run.scene
    view, (name, light) = scene.test[1], next(iter(scene.lights.items()))
    assert torch.equal(chain_model.render(view.name)["image"], chain_model.render(view)["image"])
    with pytest.raises(UsageError, match="unknown view 'test_9'"):
        chain_model.render("test_9")
    with pytest.raises(UsageError, match="unknown light 'noon'"):
        chain_model.relight("noon", view)
    lit: list[object] = []

    def prepare(self: ChainTrained, light: object = None, *further: object) -> ChainPrepared:
        lit.append(light)
        return ChainPrepared(0.5)

    monkeypatch.setattr(ChainTrained, "prepare", prepare)
    chain_model.relight(name, view.name)
    ready = chain_model.prepared(light)
    for each in scene.test:
        ready.render(each)
    assert lit == [light, light], "many views are rendered by one preparation"


def test_a_run_from_python_takes_the_options_of_the_command_and_returns_its_table(
    fake_run: Callable[..., int], tmp_path: Path
) -> None:
    assert fake_run("ablations") == 0
    finished = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "cells").iterdir()}
    options = {"scenes": ["corner"], "seeds": 2, "preset": "smoke", "shard": None}
    values = rb.run("ablations", tmp_path, **options)
    assert {path.name: path.stat().st_mtime_ns for path in (tmp_path / "cells").iterdir()} == finished
    frame = rb.open_store(tmp_path)
    for row, key in (("Ours", "ours"), ("λ_rad = 0", "no-rad")):
        mean = frame[(frame["row"] == key) & (frame["metric"] == "nvs/psnr")]["value"].mean()
        assert values.loc[row, "nvs/psnr"] == pytest.approx(mean, rel=1e-9)
    differences = rb.table(tmp_path, "difference")
    assert differences.loc["λ_rad = 0", "nvs/psnr"] == pytest.approx(
        values.loc["λ_rad = 0", "nvs/psnr"] - values.loc["Ours", "nvs/psnr"], rel=1e-6
    )
    assert differences.loc["Ours"].isna().all()
    low, high = (rb.table(tmp_path, what).loc["λ_rad = 0", "nvs/psnr"] for what in ("low", "high"))
    assert low <= differences.loc["λ_rad = 0", "nvs/psnr"] <= high
    assert set(rb.table(tmp_path, "verdict").stack().dropna()) <= {"better", "worse"}


def test_a_run_from_python_raises_the_error_that_ends_it(fake_run: Callable[..., int], tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="unknown option 'sedes'"):
        rb.run("ablations", tmp_path, sedes=3)
    with pytest.raises(DataError, match="no table in"):
        rb.table(tmp_path)
    with pytest.raises(UsageError, match="unknown field 'light_b'"):
        rb.run("ablations", tmp_path, preset="smoke", scenes=["corner"], set={"inverse_iterations": 1, "light_b": 2})


def test_the_gate_from_python_is_a_frame(fake_run: Callable[..., int], tmp_path: Path) -> None:
    assert fake_run("ablations") == 0
    assert main(["gate", str(tmp_path), "--baseline", str(tmp_path / "baseline.json"), "--update"]) == 0
    changes = rb.gate(tmp_path, tmp_path / "baseline.json")
    assert list(changes.columns) == ["severity", "cell", "what"]
    assert not {"regression", "changed"} & set(changes["severity"])


def test_errors_of_the_python_api_are_explained(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="unknown method 'radiogz'"):
        rb.train("radiogz", "corner")
    with pytest.raises(UsageError, match="radiometric_wait"):
        rb.train("radiogs", "corner", variant={"radiometric_wait": 0.0})
    with pytest.raises(UsageError, match="unknown preset"):
        rb.train("radiogs", "corner", preset="tinny")
    with pytest.raises(UsageError, match="unknown device 'gpu'"):
        rb.train("radiogs", "corner", device="gpu")
    if not torch.cuda.is_available():
        with pytest.raises(UsageError, match="no CUDA device was found"):
            rb.train("radiogs", "corner", device="cuda")
    with pytest.raises(DataError, match=r"there is no scene '.*nowhere'"):
        rb.train("radiogs", tmp_path / "nowhere")
    with pytest.raises(DataError, match="nothing was trained"):
        rb.open_model(tmp_path)
    with pytest.raises(DataError, match="no run in"):
        rb.open_store(tmp_path)
    with pytest.raises(UsageError, match=r"neither \.hdr nor \.exr"):
        rb.read_light(tmp_path / "light.png")
    with pytest.raises(AttributeError, match="no attribute 'utils'"):
        _ = rb.utils
