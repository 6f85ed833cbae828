"""A .blend file is opened in a separate process, by a request whose contents are its identity."""

import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from radiogs_core.errors import DataError, UsageError
from radiogs_datasets.blend import process
from radiogs_datasets.blend.process import Blender, blender_failure, blender_python, require_blender
from radiogs_datasets.blend.request import Request
from radiogs_datasets.generate.probe import mitsuba_failure

START = """
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
def add(name="cube", size=1.0):
    bpy.ops.mesh.primitive_cube_add(size=size)
    thing = bpy.context.object
    thing.name = name
    return thing
def painted(thing):
    material = bpy.data.materials.new("paint")
    thing.data.materials.append(material)
    return material.node_tree
"""
END = "\nbpy.ops.wm.save_as_mainfile(filepath={path!r})\n"


def saved(path: Path, code: str) -> Path:
    """A .blend file that Blender saved after running some code on an empty scene."""
    script = START + code + END.format(path=str(path))
    done = subprocess.run([blender_python(), "-W", "ignore", "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return path


def opened(blender: Blender, path: Path) -> Any:
    return blender.ask("open", file=str(path), device="cpu", threads=1)


def test_the_content_of_a_file_is_described(blender: Blender, tmp_path: Path) -> None:
    code = """
add("one"); add("two", 4.0).hide_render = True
bpy.ops.object.light_add(type="SUN"); bpy.ops.object.camera_add()
scene.unit_settings.scale_length = 0.001
"""
    found = opened(blender, saved(tmp_path / "a.blend", code))
    assert (found["low"], found["high"]) == ([-0.5] * 3, [0.5] * 3)
    assert (found["objects"], found["lamps"], found["cameras"], found["unit_scale"]) == (1, 1, 1, pytest.approx(0.001))
    assert found["not_understood"] == {}


@pytest.mark.parametrize("content", [b"", b"BLENDER", b"not a file of Blender's" * 100])
def test_other_files_than_blend_files_are_an_error(blender: Blender, tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.blend").write_bytes(content)
    with pytest.raises(DataError, match=r"is no \.blend file"):
        opened(blender, tmp_path / "a.blend")


def test_a_truncated_file_is_an_error_or_ends_the_process_with_words(tmp_path: Path, blender: Blender) -> None:
    assert blender is not None
    whole = saved(tmp_path / "whole.blend", "add()").read_bytes()
    for part in (0.1, 0.5, 0.9):
        (tmp_path / "cut.blend").write_bytes(whole[: int(part * len(whole))])
        with Blender(tmp_path / "log") as own, pytest.raises(DataError):
            opened(own, tmp_path / "cut.blend")


@pytest.mark.parametrize("code", ["", "add().hide_render = True", "bpy.ops.object.light_add(type='SUN')"])
def test_nothing_to_render_is_an_error(blender: Blender, tmp_path: Path, code: str) -> None:
    with pytest.raises(DataError, match="nothing to render"):
        opened(blender, saved(tmp_path / "a.blend", code))


def test_linked_files_that_are_missing_are_named_together(blender: Blender, tmp_path: Path) -> None:
    code = f"""
tree = painted(add())
for name in ("wood", "stone"):
    image = bpy.data.images.new(name, 4, 4)
    image.filepath_raw = {str(tmp_path)!r} + "/" + name + ".png"; image.file_format = "PNG"; image.save()
    node = tree.nodes.new("ShaderNodeTexImage"); node.image = bpy.data.images.load(image.filepath_raw)
"""
    path = saved(tmp_path / "a.blend", code)
    assert opened(blender, path)["objects"] == 1
    (tmp_path / "wood.png").unlink()
    (tmp_path / "stone.png").unlink()
    with pytest.raises(DataError, match="links 2 files that are not there") as caught:
        opened(blender, path)
    assert "stone.png" in str(caught.value)
    assert "wood.png" in str(caught.value)


def test_a_missing_library_is_named_and_one_that_is_there_is_rendered(blender: Blender, tmp_path: Path) -> None:
    library = saved(tmp_path / "library.blend", "painted(add('chair'))")
    code = f"""
with bpy.data.libraries.load({str(library)!r}, link=True) as (there, here):
    here.objects = ["chair"]
scene.collection.objects.link(bpy.data.objects["chair"])
"""
    path = saved(tmp_path / "a.blend", code)
    found = opened(blender, path)
    assert (found["objects"], found["not_understood"]) == (1, {})
    library.unlink()
    with pytest.raises(DataError, match=r"library\.blend"):
        opened(blender, path)


def test_scripts_and_drivers_of_a_file_are_counted_and_not_run(blender: Blender, tmp_path: Path) -> None:
    mark = tmp_path / "it_ran"
    code = f"""
thing = add()
text = bpy.data.texts.new("run.py")
text.write("open({str(mark)!r}, 'w').close()")
text.use_module = True
bpy.app.driver_namespace["touch"] = lambda: 1.0
driver = thing.driver_add("location", 0).driver
driver.type = "SCRIPTED"
driver.expression = "touch() or __import__('pathlib').Path({str(mark)!r}).touch()"
"""
    path = saved(tmp_path / "a.blend", code)
    mark.unlink(missing_ok=True)
    assert opened(blender, path)["scripts"] == 2
    assert not mark.exists()


def test_materials_that_are_not_understood_are_counted_by_their_node(blender: Blender, tmp_path: Path) -> None:
    code = """
tree = painted(add())
output = tree.get_output_node("CYCLES")
tree.links.new(tree.nodes.new("ShaderNodeBsdfToon").outputs[0], output.inputs["Surface"])
painted(add("two"))
add("three")
"""
    found = opened(blender, saved(tmp_path / "a.blend", code))
    assert found["not_understood"] == {"ShaderNodeBsdfToon": 1}
    assert found["materials"] == 3


def test_a_gpu_that_is_not_there_is_an_error(blender: Blender, tmp_path: Path) -> None:
    path = saved(tmp_path / "a.blend", "add()")
    try:
        blender.ask("open", file=str(path), device="cuda", threads=1)
    except DataError as error:
        assert "no CUDA device" in str(error)  # noqa: PT017  a machine with a GPU has nothing to refuse


ECHO = """
import json, os, sys
answers = os.fdopen(int(sys.argv[2]), "w")
for line in sys.stdin:
    task = json.loads(line)
    print("working on", task["task"], flush=True)
    if task["task"] == "die":
        sys.exit(11)
    wrong = {"what": "it is bent", "why": "it fell", "remedy": "Lift it."}
    answers.write(json.dumps({"error": wrong} if task["task"] == "complain" else {"done": task}) + "\\n")
    answers.flush()
"""


@pytest.fixture
def echo(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that answers with its task; it does not need Blender."""
    monkeypatch.setattr(process, "SERVE", ECHO)
    monkeypatch.setenv(process.PYTHON_VARIABLE, sys.executable)


@pytest.mark.usefixtures("echo")
def test_tasks_are_answered_one_by_one(tmp_path: Path) -> None:
    with Blender(tmp_path / "log") as blender:
        assert blender.ask("open", file="a") == {"task": "open", "file": "a"}
        assert blender.ask("render", size=4) == {"task": "render", "size": 4}


@pytest.mark.usefixtures("echo")
def test_a_complaint_is_an_error_and_the_next_task_is_answered(tmp_path: Path) -> None:
    with Blender(tmp_path / "log") as blender:
        with pytest.raises(DataError, match=r"it is bent\nit fell\nLift it\."):
            blender.ask("complain")
        assert blender.ask("open") == {"task": "open"}


@pytest.mark.usefixtures("echo")
def test_an_ended_process_is_reported_with_its_last_words(tmp_path: Path) -> None:
    with Blender(tmp_path / "log") as blender:
        with pytest.raises(DataError, match=r"ended by itself \(exit code 11\) at the task 'die'") as caught:
            blender.ask("die")
        assert "working on die" in str(caught.value)
        with pytest.raises(DataError, match="ended by itself"):
            blender.ask("open")


def test_a_python_without_blender_names_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(process.PYTHON_VARIABLE, str(tmp_path / "no_python"))
    with pytest.raises(UsageError, match="No such file") as caught:
        require_blender()
    assert "pip install 'radiogs-bench[blend]'" in str(caught.value)
    shadow = tmp_path / "bpy.py"
    shadow.write_text("raise ImportError('made for another Python')")
    monkeypatch.setenv(process.PYTHON_VARIABLE, sys.executable)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(UsageError, match="made for another Python"):
        require_blender()


@pytest.mark.usefixtures("echo")
def test_trials_and_blender_import_no_module_of_the_folder_where_they_are_started(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("bpy", "mitsuba", "json"):
        (tmp_path / f"{name}.py").write_text("from pathlib import Path\nPath(__file__).with_name('ran').touch()\n")
    monkeypatch.chdir(tmp_path)
    blender_failure()
    mitsuba_failure()
    with Blender(tmp_path / "log") as blender:
        blender.ask("open")
    assert not (tmp_path / "ran").exists()


@pytest.fixture
def asked(tmp_path: Path, lights: Path) -> Request:
    (tmp_path / "scene.blend").write_bytes(b"a file")
    return Request(tmp_path / "scene.blend", lights)


def test_the_training_light_is_first(asked: Request) -> None:
    assert [*asked.light_files] == ["training", "spot"]
    assert [*replace(asked, training_light="spot").light_files] == ["spot", "training"]
    (asked.lights / "training.hdr").unlink()
    assert [*replace(asked).light_files] == ["spot"]


def test_lights_that_are_not_there_are_named(asked: Request, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no light 'moon'") as caught:
        _ = replace(asked, training_light="moon").light_files
    assert "spot, training" in str(caught.value)
    with pytest.raises(UsageError, match="holds no light"):
        _ = replace(asked, lights=tmp_path).light_files
    with pytest.raises(UsageError, match="holds no light"):
        _ = replace(asked, lights=tmp_path / "absent").light_files
    shutil.copy(asked.lights / "spot.hdr", asked.lights / "spot.exr")
    with pytest.raises(UsageError, match="one name"):
        _ = replace(asked).light_files


@pytest.mark.parametrize(
    "other",
    [{"training_light": "spot"}, {"cameras": "fit"}, {"train": 3}, {"test": 3}, {"size": 8}, {"samples": 3},
     {"bounces": 3}, {"seed": 3}, {"device": "cuda"}, {"keep_passes": True}],
)  # fmt: skip
def test_every_option_is_part_of_the_identity(asked: Request, other: dict[str, object]) -> None:
    assert replace(asked, **other).identity() != asked.identity()  # type: ignore[arg-type]


def test_contents_are_part_of_the_identity_and_places_are_not(asked: Request, tmp_path: Path) -> None:
    moved = tmp_path / "moved"
    shutil.copytree(asked.lights, moved / "lights")
    shutil.copy(asked.file, moved / "other.blend")
    elsewhere = replace(asked, file=moved / "other.blend", lights=moved / "lights")
    assert elsewhere.identity() == asked.identity()
    elsewhere.file.write_bytes(b"another file")
    assert replace(elsewhere).identity() != asked.identity()
    elsewhere.file.write_bytes(b"a file")
    shutil.copy(moved / "lights" / "spot.hdr", moved / "lights" / "training.hdr")
    assert replace(elsewhere).identity() != asked.identity()


def test_a_file_that_cannot_be_read_is_an_error(asked: Request, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot read"):
        replace(asked, file=tmp_path / "absent.blend").identity()
