"""``methods check``: a method that keeps its contract passes, and each thing that it may do wrong is named."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
import torch

from bench.chain_method import Chain, ChainPrepared, ChainStage, ChainTrained
from radiogs_bench.cli.main import main
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.runs.contract_check import check_method, difference
from radiogs_core.contract import MapKind, Run
from radiogs_core.scene.scene import Scene
from scenes import sphere_scene

CPU = torch.device("cpu")
SCENE = sphere_scene(views=3, size=16)


def failures(method: Any, folder: Path, scene: Scene = SCENE) -> list[str]:
    found = list(check_method(method, scene, "smoke", CPU, folder, lambda line: None))
    assert all(each.remedy for each in found if each.verdict == "fails")
    return [each.what for each in found if each.verdict == "fails"]


def test_a_sound_method_passes_and_unread_fields_are_noted(tmp_path: Path) -> None:
    found = list(check_method(Chain(("one", "two")), SCENE, "smoke", CPU, tmp_path, lambda line: None))
    assert [each for each in found if each.verdict == "fails"] == []
    notes = [each.what for each in found if each.verdict == "note"]
    assert notes == [
        "no stage has in `reads`: variant shown",
        "relighting is not offered: Chain keeps light and surface in one",
    ]
    assert len(found) > 10


def forgetful(stage: ChainStage) -> dict[str, Any]:
    """A state without the generator."""
    return {"iteration": stage.iteration, "value": stage.value, "generator": torch.Generator().get_state()}


def unseeded(stage: ChainStage) -> Mapping[str, float]:
    stage.iteration += 1
    stage.value = stage.value + torch.rand(())
    return {"image": 0.1}


def too_many(stage: ChainStage) -> Mapping[str, float]:
    stage.iterations = 7
    return STEP(stage)


def peeking(stage: ChainStage) -> Mapping[str, float]:
    stage.chain.runs[-1].scene.test[0].read("image")
    return STEP(stage)


def nan(stage: ChainStage) -> Mapping[str, float]:
    return {**STEP(stage), "image": float("nan")}


def arrays(stage: ChainStage) -> dict[str, Any]:
    return {"value": stage.value.numpy()}


STEP = ChainStage.step


@pytest.mark.parametrize(
    ("member", "wrong", "said"),
    [
        ("state", forgetful, "a training that is interrupted and one that is not"),
        ("step", unseeded, "two trainings with the same seed"),
        ("step", too_many, "steps of stages: 'one' announces 3, takes 7"),
        ("step", peeking, f"training read the test views: 'image' of '{SCENE.test[0].name}'"),
        ("step", lambda stage: {}, "came back 1000 times in a row"),
        ("step", nan, "loss 'image' is nan in stage 'one' at iteration 0"),
        ("state", arrays, "state()['value'] of stage 'one' is a numpy.ndarray"),
        ("product", arrays, "product()['value'] of stage 'one' is a numpy.ndarray"),
    ],
)
def test_mistakes_of_a_stage_are_named(
    member: str, wrong: Callable[[ChainStage], Any], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ChainStage, member, wrong)
    found = failures(Chain(("one",)), tmp_path)
    assert any(said in each for each in found), found


def shows(**maps: tuple[MapKind, torch.Tensor]) -> type[ChainPrepared]:
    """A model that shows these maps, [channels] each, at every pixel."""

    class Shows(ChainPrepared):
        offers: Mapping[str, MapKind] = {name: kind for name, (kind, _) in maps.items()}

        def render(self, camera: Any, *further: str) -> dict[str, torch.Tensor]:
            return {name: value.expand(camera.height, camera.width, -1).clone() for name, (_, value) in maps.items()}

    return Shows


GREY = (MapKind("display"), torch.full((3,), 0.5))


class Drawing(ChainPrepared):
    def render(self, camera: Any, *further: str) -> dict[str, torch.Tensor]:
        return {name: torch.rand_like(image) for name, image in super().render(camera).items()}  # type: ignore[arg-type]


def linear_truth() -> type[ChainPrepared]:
    """The true image, with linear values that are declared as display sRGB."""

    class Linear(ChainPrepared):
        def render(self, camera: Any, *further: str) -> dict[str, torch.Tensor]:
            (view,) = [each for each in SCENE.test if torch.equal(each.camera.centre, camera.centre)]
            alpha = view.read("alpha")
            return {"image": (view.read("image") * alpha) ** 2.2, "alpha": alpha}

    return Linear


@pytest.mark.parametrize(
    ("shown", "said"),
    [
        (shows(image=GREY, roughness=(MapKind("data"), torch.full((1,), 3.0))), "roughness from 3 to 3"),
        (shows(image=GREY, albedo=(MapKind("linear"), torch.full((3,), -0.5))), "albedo from -0.5 to -0.5"),
        (shows(image=GREY, normal=(MapKind("data"), torch.full((3,), 0.5))), "normals of length 0.866"),
        (shows(image=(MapKind("display"), torch.full((1,), 0.5))), "a map 'image' of shape (16, 16, 1)"),
        (shows(albedo=(MapKind("linear"), torch.full((3,), 0.5))), "there is no map 'image'"),
        (Drawing, "a view rendered again, after another view differs: map['image']"),
        (linear_truth(), "dB better if its colours are taken for linear"),
    ],
)
def test_mistakes_of_a_rendering_are_named(
    shown: type[ChainPrepared], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ChainTrained, "prepare", lambda model, light=None, *rest: shown(0.5))
    found = failures(Chain(("one",)), tmp_path)
    assert any(said in each for each in found), found


def test_a_light_that_is_not_used_and_files_that_are_not_there_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ChainTrained, "prepare", lambda model, *lit: ChainPrepared(0.5))
    monkeypatch.setattr(ChainTrained, "export", lambda model, folder: [folder / "surfels.ply"])
    found = failures(Chain(("one",)), tmp_path)
    assert "a view under another light is the view under its own" in found
    assert any("surfels.ply" in each for each in found)


@pytest.mark.parametrize(
    ("lit", "said"),
    [
        (shows(image=(MapKind("display"), torch.zeros(3))), "a view under another light is black"),
        (shows(albedo=(MapKind("linear"), torch.ones(3))), "a relit view has no map 'image'"),
        (shows(image=GREY), "a view under another light is the view under its own"),
        (shows(image=(MapKind("display"), torch.full((3,), 0.25))), "relit views do not depend on albedo_scale"),
    ],
)
def test_wrong_relighting_is_named(
    lit: type[ChainPrepared], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        ChainTrained, "prepare", lambda model, light=None, *rest: (lit if light else shows(image=GREY))(0.5)
    )
    assert said in failures(Chain(("one",)), tmp_path)


def test_a_method_whose_stages_cannot_be_listed_is_a_finding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Chain, "stages", lambda method, variant, budget: 1 / 0)
    (found,) = failures(Chain(("one",)), tmp_path)
    assert "failed in stages(): ZeroDivisionError" in found


def test_relighting_by_a_model_that_shows_nothing_yet_is_not_called_broken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ChainTrained, "prepare", lambda model, *lit: ChainPrepared(0.0))
    found = list(check_method(Chain(("one",)), SCENE, "smoke", CPU, tmp_path, lambda line: None))
    assert [each.what for each in found if each.verdict == "fails"] == []
    assert any("the model shows nothing yet" in each.what for each in found)


def test_a_model_that_depends_on_more_than_its_product_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second model is another one than the first."""
    made: list[Run] = []

    def restore(method: Chain, run: Run, tensors: Mapping[str, Any]) -> ChainTrained:
        made.append(run)
        return ChainTrained(tensors["value"], 1 / len(made))

    monkeypatch.setattr(Chain, "restore", restore)
    found = failures(Chain(("one",)), tmp_path)
    assert any("the model that restore() makes a second time differs" in each for each in found), found


@pytest.mark.parametrize(
    ("one", "other", "where"),
    [
        ({"a": torch.tensor([1.0, float("nan")])}, {"a": torch.tensor([1.0, float("nan")])}, ""),
        ({"a": [torch.zeros(2), 1]}, {"a": [torch.zeros(2), 2]}, "['a'][1]"),
        ({"a": torch.zeros(2)}, {"a": torch.zeros(2, dtype=torch.float64)}, "['a']"),
        ({"a": {"b": 1}}, {"a": {"c": 1}}, "['a']"),
    ],
)
def test_the_place_of_a_difference(one: Any, other: Any, where: str) -> None:
    assert difference(one, other) == where


def test_the_command_prints_a_line_for_each_rule(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(substitutes, "chain", Chain(("one", "two")))
    assert main(["methods", "check", "chain", "--scene", "convex"]) == 0
    said = capsys.readouterr().out
    assert "holds  a training that is interrupted and one that is not are the same to the last bit" in said
    assert said.endswith("chain: nothing is broken\n")
    monkeypatch.setattr(ChainStage, "step", unseeded)
    assert main(["methods", "check", "chain", "--scene", "convex", "--json"]) == 1
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {line["verdict"] for line in lines} == {"holds", "note", "fails"}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["check"], "METHOD requires an argument"),
        (["check", "nobody"], "unknown method 'nobody'"),
        (["check", "chain", "--preset", "huge"], "unknown preset 'huge'"),
        (["chain", "--scene", "convex"], "Unknown option: --scene"),
        (["chain", "radiogs"], "there is no place for radiogs"),
        (["check", "chain", "--recipes"], "Unknown option: --recipes"),
    ],
)
def test_wrong_calls_are_explained(
    arguments: list[str], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(substitutes, "chain", Chain(("one",)))
    assert main(["methods", *arguments]) == 2
    assert said in capsys.readouterr().err
