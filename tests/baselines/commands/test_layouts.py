"""A stand-in code is trained, rendered and relit through the contract, in the layout of every published code."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from baselines.commands.bench import Bench, Cells, Shelf, method_of, toml
from public_outputs import Maps
from radiogs_baselines.commands.method import CommandBudget, CommandVariant
from radiogs_core import contract
from radiogs_core.errors import DataError, ExplainedError
from radiogs_core.scene.scene import Scene
from radiogs_datasets.image_files import read_image

LAYOUTS = ("radiogs", "irgs", "gs-ir", "gi-gs", "r3dg", "svg-ir", "tensoir", "plain")
BY_NAME = ("r3dg", "svg-ir")
"""Their results under eval/ are named by the last part of a view's image, the same for all views of this layout."""


@pytest.mark.slow
@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_code_is_trained_rendered_and_relit(
    layout: str, convex: Scene, predicted: dict[str, Maps], tmp_path: Path, shelf: Shelf
) -> None:
    laid = shelf(layout)
    maps = '\nmaps = ["albedo", "normal"]' if layout == "r3dg" else ""
    text = toml(
        ["--name|model-1", "--name|model-2"],
        laid + maps,
        f"{laid}|--light|{{light}}|--light_file|{{light_file}}",
        layout,
    )
    method = method_of(tmp_path, text)
    assert isinstance(method, contract.Method)
    bench = Bench(method, convex, tmp_path / "work")
    trained = bench.train()
    assert isinstance(trained, contract.Trained)
    prepared = trained.prepare()
    assert isinstance(prepared, contract.Prepared)
    assert not prepared.timed
    assert prepared.default == set(prepared.offers)
    assert ("image" in prepared.offers) == (layout != "r3dg")
    for view in convex.test:
        maps_of_view = prepared.render(view.camera)
        truth = predicted[view.name]
        assert set(maps_of_view) == set(prepared.offers)
        for name in {"image", "albedo"} & set(prepared.offers):
            assert (maps_of_view[name] - truth[name]).abs().max() < 0.02
        inside = truth["alpha"][..., 0] == 1
        cosine = (maps_of_view["normal"] * (2 * truth["normal"] - 1)).sum(-1)
        assert cosine[inside].min() > 0.97
    for name, light in convex.lights.items():
        relit = trained.prepare(light)
        assert set(relit.offers) == {"image"}
        for view in (view for view in convex.test if view.has(f"relit/{name}")):
            assert (relit.render(view.camera)["image"] - predicted[view.name][f"relit/{name}"]).abs().max() < 0.02


def test_a_camera_that_was_not_rendered_is_refused(convex: Scene, cell_of: Cells, shelf: Shelf) -> None:
    text = toml(["--name|model-1"], shelf("irgs"), reader="irgs")
    prepared = cell_of(text).train().prepare()
    with pytest.raises(DataError, match="was not rendered from this camera"):
        prepared.render(convex.train[0].camera)
    with pytest.raises(DataError, match="was not rendered from this camera"):
        prepared.render(replace(convex.test[0].camera, fx=1.0))


def test_facts_state_the_commands_and_their_cost(convex: Scene, tmp_path: Path, cell_of: Cells, shelf: Shelf) -> None:
    laid = shelf("irgs")
    text = toml(["--name|model-1"], laid, f"{laid}|--light|{{light}}", "irgs", 'traps = ["It is none."]')
    bench = cell_of(text)
    trained = bench.train()
    trained.prepare()
    light = next(iter(convex.lights))
    trained.prepare(convex.lights[light])
    facts = trained.facts()
    assert set(facts["commands"]) == {"stage-1", "render", f"relight-{light}"}
    for record in facts["commands"].values():
        assert record["exit_code"] == 0
        assert record["seconds"] > 0
        assert record["peak_bytes"] is None or record["peak_bytes"] > 2**18
    assert all(Path(log).read_text().startswith(("train", "render", "relight")) for log in facts["logs"].values())
    assert facts["remarks"][0] == "It is none."
    assert facts["code"]["commit"] == "0123456"
    assert any("0123456" in remark for remark in facts["remarks"]), "the checkout is at another commit"
    (where,) = trained.export(tmp_path / "export")
    assert str(tmp_path / "work" / "output") in where.read_text()
    assert trained.light is None


def test_a_command_is_not_run_again_while_its_results_are_there(
    convex: Scene, tmp_path: Path, cell_of: Cells, shelf: Shelf
) -> None:
    note = tmp_path / "note"
    laid = f"{shelf('gs-ir')}|--note|{note}"
    text = toml([f"--name|model-1|--note|{note}"], laid, f"{laid}|--light|{{light}}", "gs-ir")
    bench = cell_of(text)
    for _ in range(2):
        trained = bench.train()
        trained.prepare()
        for light in convex.lights.values():
            trained.prepare(light)
    runs = [line.split()[0] for line in note.read_text().splitlines()]
    assert runs == ["train", "render", *["relight"] * len(convex.lights)]
    next((tmp_path / "work" / "output").rglob("*_brdf.png")).unlink()
    trained.prepare()
    assert note.read_text().splitlines()[-1].startswith("render")


def test_renderings_of_another_training_are_replaced(tmp_path: Path, cell_of: Cells, shelf: Shelf) -> None:
    note = tmp_path / "note"
    laid = f"{shelf('gs-ir')}|--note|{note}"
    text = toml(["--name|model-1"], laid, reader="gs-ir", head="resumes = true").replace('["--resume"]', "[]")
    bench = cell_of(text)
    for runs in (1, 2):
        bench.train().prepare()
        assert len(note.read_text().splitlines()) == runs
        (bench.workspace / "output" / "model-1.pth").unlink()
        bench.states = []


def test_files_of_another_command_are_not_taken_as_results(cell_of: Cells) -> None:
    """A workspace belongs to one cell; if two cells share it, neither takes the other's results."""
    for size in (5, 6):
        bench = cell_of(toml([f"--name|model-1|--size|{size}"]))
        bench.train()
        assert (bench.workspace / "output" / "model-1.pth").stat().st_size == size


def test_all_lights_at_once_are_one_command(convex: Scene, tmp_path: Path, cell_of: Cells, shelf: Shelf) -> None:
    note, names = tmp_path / "note", "|".join(convex.lights)
    laid = shelf("tensoir")
    relight = f"{laid}|--note|{note}|--lights|{names}\nall_lights = true"
    bench = cell_of(toml(["--name|model-1"], laid, relight, "tensoir"))
    trained = bench.train()
    for light in convex.lights.values():
        trained.prepare(light)
    assert len(note.read_text().splitlines()) == 1


def test_views_elsewhere_are_relit_by_their_names(convex: Scene, cell_of: Cells, shelf: Shelf) -> None:
    scene = replace(convex, test=convex.test[:4], relight=convex.test[4:6])
    laid = shelf("plain")
    text = toml(["--name|model-1"], laid, f"{laid}|--light|{{light}}")
    trained = cell_of(text, scene=scene).train()
    name, light = next(iter(scene.lights.items()))
    relit = trained.prepare(light)
    for view in (*scene.test, *scene.relight):
        truth = view.read(f"relit/{name}") * (view.read("alpha") == 1)
        assert (relit.render(view.camera)["image"] - truth).abs().mean() < 0.05


def test_numbered_files_are_of_test_views_and_of_no_view_elsewhere(
    convex: Scene, pantry: Callable[[str], Path], tmp_path: Path, cell_of: Cells
) -> None:
    scene = replace(convex, test=convex.test[:4], relight=convex.test[4:6])
    name, light = next(iter(scene.lights.items()))
    numbered = Path(shutil.copytree(pantry("plain"), tmp_path / "numbered"))
    for number, view in enumerate(convex.test):
        file = numbered / "relit" / name / f"{view.name}.png"
        if number < 4:
            file.rename(file.with_name(f"{number:05d}.png"))
        else:
            file.unlink()
    text = toml(["--name|model-1"], f"--pantry|{numbered}", f"--pantry|{numbered}|--light|{{light}}")
    trained = cell_of(text, scene=scene).train()
    with pytest.raises(ExplainedError, match="holds no prediction of scene 'convex'"):
        trained.prepare(light)
    for view in scene.relight:
        shutil.copy(pantry("plain") / "relit" / name / f"{view.name}.png", numbered / "relit" / name)
    relit = cell_of(text, "again", scene).train().prepare(light)
    for view in (*scene.test, *scene.relight):
        truth = view.read(f"relit/{name}") * (view.read("alpha") == 1)
        assert (relit.render(view.camera)["image"] - truth).abs().mean() < 0.05


def test_a_code_reads_the_lights_of_the_scene(convex: Scene, tmp_path: Path, cell_of: Cells, shelf: Shelf) -> None:
    laid = f"{shelf('plain')}|--light|{{light}}|--light_file|{{light_file}}"
    bench = cell_of(toml(["--name|model-1"], "", laid))
    trained = bench.train()
    name, light = next(iter(convex.lights.items()))
    trained.prepare(light)
    written = torch.from_numpy(read_image(tmp_path / "work" / "lights" / f"{name}.hdr"))
    assert torch.allclose(written, light.radiance, rtol=0.01, atol=0.01 * float(light.radiance.max()))


def test_arguments_of_a_variant_reach_the_last_command_or_the_one_that_asks(tmp_path: Path, cell_of: Cells) -> None:
    note = tmp_path / "note"
    variant = CommandVariant(("--size", "17"))
    last = toml([f"--name|model-1|--note|{note}", f"--name|model-2|--note|{note}"])
    first = last.replace('"model-1"', '"model-1", "{arguments}"')
    for text, expected in ((last, [False, True]), (first, [True, False])):
        note.unlink(missing_ok=True)
        cell_of(text, f"work-{expected[0]}", variant=variant).train()
        assert ["--size 17" in line for line in note.read_text().splitlines()] == expected
    plain, varied = (
        method_of(tmp_path, last).stages(each, CommandBudget("tiny")) for each in (CommandVariant(), variant)
    )
    assert plain[0].reads != varied[0].reads
