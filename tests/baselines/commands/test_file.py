"""A wrong value in a method's file, or one that does not fit a run, raises an error that names the possible values."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from baselines.commands.bench import Bench, Cells, method_of, toml
from radiogs_baselines.commands.method import CommandBudget, CommandMethod, read_method
from radiogs_baselines.commands.placeholders import filled_list
from radiogs_core.contract import NotOffered, scaled
from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene

SOUND = toml(["--name|model-1"], "--pantry|{code}", "--pantry|{code}|--light|{light}")
ANOTHER = "\n[[train]]\nname = '{}'\narguments = [{}]\nwrites = ['{{output}}']"

WRONG = {
    "unknown field": (SOUND.replace("reader =", "readr ="), "there is no field 'readr'", "Did you mean 'reader'?"),
    "unknown field within": (SOUND.replace("writes =", "write ="), "train[0]: there is no field 'write'", "'writes'"),
    "missing fields": (
        SOUND.replace('title = "Stand-in"', "").replace("layouts = [", "# ["),
        "it lacks 'title', 'layouts'",
        "",
    ),
    "public code of unknown origin": (
        SOUND.replace("url = ", "# ").replace("licence = ", "# "),
        "code: it lacks url, licence",
        "folder",
    ),
    "no TOML": ("name = ", "is not valid TOML", ""),
    "wrong type": (SOUND.replace('title = "Stand-in"', "title = 3"), "title: 3 is not text", ""),
    "no list": (SOUND.replace('layouts = ["tensoir"]', 'layouts = "tensoir"'), "'tensoir' is not a list", ""),
    "unknown reader": (SOUND.replace('"plain"', '"gsir"'), "there is no reader 'gsir'", "Did you mean 'gs-ir'?"),
    "unknown layout": (SOUND.replace('"tensoir"]', '"tensorir"]'), "no layout 'tensorir'", "Did you mean 'tensoir'?"),
    "no layout": (SOUND.replace('["tensoir"]', "[]"), "layouts: the list is empty", "layouts of scenes"),
    "bad name": (SOUND.replace('"stand-in"', '"Stand in"', 1), "'Stand in' is not a name", "small letters"),
    "no code": (SOUND.replace('variable = "STAND_IN_HOME"', ""), "the location of the code is missing", "variable"),
    "unknown placeholder": (SOUND.replace("{scene}", "{scnee}", 1), "placeholder '{scnee}'", "Did you mean '{scene}'?"),
    "lone brace": (SOUND.replace("{scene}", "{scene", 1), "cannot be read", "Braces enclose placeholders"),
    "format": (SOUND.replace("{scene}", "{seed:03}", 1), "has a format", ""),
    "light in training": (SOUND.replace("model-1", "{light}", 1), "placeholder '{light}'", "only in [relight]"),
    "light of all": (SOUND + "\nall_lights = true", "placeholder '{light}'", "without all_lights"),
    "list within text": (SOUND.replace("model-1", "x{arguments}", 1), "placeholder '{arguments}'", "of its own"),
    "results elsewhere": ("results = '/tmp'\n" + SOUND, "'/tmp' is not in {output}", "its own folder"),
    "results up": ("results = '{output}/../x'\n" + SOUND, "is not in {output}", ""),
    "writes nothing": (SOUND.replace("['{output}/model-1.pth']", "[]"), "writes: the list is empty", ""),
    "two of a name": (SOUND + ANOTHER.format("stage-1", "'x'"), "two commands", ""),
    "reserved name": (SOUND.replace("'stage-1'", "'render'"), "'render' is not a name of a command", ""),
    "no time": (SOUND + "\ntime_limit = 0", "relight.time_limit: 0 is not above zero", "seconds"),
    "resume": (SOUND.replace("writes =", "resume = ['x']\nwrites ="), "only with resumes = true", ""),
    "unknown preset": (SOUND + "\n[presets.big]\niterations = 3", "there is no preset 'big'", "smoke"),
    "iterations": (SOUND.replace("model-1", "{total}", 1), "presets.smoke: the field 'further' is missing", "{total}"),
    "setting": (SOUND + "\n[settings]\nseed = []", "'seed' cannot be the name of a setting", ""),
    "setting of a scene": (SOUND + "\n[scenes.lego]\nrough = []", "there is no setting 'rough'", ""),
    "suffix": (SOUND + "\nlight_suffix = '.png'", "there is no suffix '.png'", ".hdr"),
    "variable": (SOUND + "\n[environment]\n'A B' = 'x'", "'A B' is not a name of an environment variable", ""),
    "no arguments": (SOUND + ANOTHER.format("x", ""), "its first", ""),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_values_in_a_file_are_named(case: str, tmp_path: Path) -> None:
    text, what, hint = WRONG[case]
    with pytest.raises(UsageError) as error:
        method_of(tmp_path, text)
    said = str(error.value)
    assert what.lower() in said.lower()
    assert hint in said
    assert str(tmp_path / "method.toml") in error.value.what
    assert error.value.remedy


def test_a_sound_file_is_read_and_a_missing_one_is_named(tmp_path: Path) -> None:
    assert isinstance(method_of(tmp_path, SOUND), CommandMethod)
    own = re.sub(r"\[code\](\n.+){4}", '[code]\nfolder = "."', SOUND)
    assert "url" not in own
    assert isinstance(method_of(tmp_path, own), CommandMethod), "a code of one's own needs no origin"
    with pytest.raises(DataError, match="cannot read the method"):
        read_method(tmp_path / "none.toml")


def test_placeholders_are_filled_once_and_lists_are_spread() -> None:
    values = {"a": "{b} c", "b": "x"}
    found = filled_list(["{a}-{{b}}-{b}", "{more}", "-{b}"], values, {"more": ["1 2", "{b}"]})
    assert found == ("{b} c-{b}-x", "1 2", "{b}", "-x")


def test_presets_can_be_multiplied(tmp_path: Path) -> None:
    names = ("smoke", "tiny", "small", "paper")
    presets = "\n".join(f"[presets.{name}]\niterations = 100\nfurther = 20" for name in names)
    method = method_of(tmp_path, SOUND.replace("model-1", "{total}", 1) + f"\n{presets}")
    assert method.presets["paper"] == CommandBudget("paper", 100, 20)
    assert scaled(method.presets["paper"], {"iterations": 2.0}).iterations == 200


def test_a_run_that_a_code_cannot_read_is_refused_before_anything_starts(
    convex: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    method = method_of(tmp_path, SOUND)
    run = Bench(method, convex, tmp_path / "work").run
    (stage,) = method.stages(run.variant, run.budget)
    for changed, said in (
        (replace(run, workspace=None), "needs a folder for its files"),
        (replace(run, scene=replace(convex, folder=None)), "this scene is computed"),
        (replace(run, scene=replace(convex, layout="colmap")), "which is in the layout colmap"),
        (replace(run, scene=replace(convex, options={"reduce": 2})), "with these options: reduce 2"),
    ):
        with pytest.raises(UsageError) as error:
            stage.begin(changed, {})
        assert said in str(error.value)
        assert error.value.remedy
    monkeypatch.setenv("STAND_IN_HOME", str(tmp_path / "none"))
    with pytest.raises(UsageError, match="there is no folder"):
        stage.begin(run, {}).step()
    monkeypatch.delenv("STAND_IN_HOME")
    with pytest.raises(UsageError, match="STAND_IN_HOME, which holds the folder of a checkout, is not set") as error:
        stage.begin(run, {}).step()
    assert "git checkout 0123456" in error.value.remedy
    assert not (tmp_path / "work").exists() or not any((tmp_path / "work").rglob("*.log"))


def test_settings_follow_the_scene(tmp_path: Path, cell_of: Cells) -> None:
    note = tmp_path / "note"
    text = toml([f"--name|model-1|--note|{note}|{{size}}"]) + "\n[settings]\nsize = ['--size', '5']"
    for here, size in ((None, 5), ("['--size', '6']", 6), ("[]", 1000)):
        more = f"\n[scenes.convex]\nsize = {here}" if here else ""
        bench = cell_of(text + more, f"work-{size}")
        bench.train()
        assert (bench.workspace / "output" / "model-1.pth").stat().st_size == size


def test_a_light_or_camera_outside_the_scene_is_refused(convex: Scene, cell_of: Cells) -> None:
    trained = cell_of(SOUND).train()
    with pytest.raises(DataError, match="a light that is not one of the scene's"):
        trained.prepare(EnvironmentMap(torch.ones(2, 4, 3)))
    without = cell_of(toml(["--name|model-1"]), "other").train()
    with pytest.raises(NotOffered, match="no command that relights"):
        without.prepare(next(iter(convex.lights.values())))
    with pytest.raises(DataError, match="holds no prediction"):
        without.prepare()
