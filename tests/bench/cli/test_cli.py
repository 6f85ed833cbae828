"""The command line: exit codes, three-part messages, and a whole run of the fake method."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch

import radiogs_bench
import radiogs_datasets
from bench import fake_method
from radiogs_bench.cli import main
from radiogs_bench.cli.main import app, parsed, values_of
from radiogs_bench.runs import progress
from radiogs_bench.runs.sweep import read_sweep
from radiogs_bench.store.folder import Store
from radiogs_bench.suites.registry import SUITES
from radiogs_core.errors import NumericalFailure, UsageError
from radiogs_datasets import generate, load_scene
from radiogs_datasets.options import SceneOptions

CORNER = Path(radiogs_datasets.__file__).parent / "tiny" / "corner"


def program(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """The installed program as a user starts it."""
    command = [str(Path(sys.executable).with_name("radiogs-bench")), *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_an_unknown_scene_ends_with_exit_code_3_and_no_traceback(tmp_path: Path) -> None:
    done = program("run", "ablations", "--scenes", "no_such_scene", folder=tmp_path)
    assert done.returncode == 3
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert done.stderr.startswith("error: ")
    assert "no_such_scene" in done.stderr
    assert done.stderr.endswith("(exit code 3)\n")
    assert list(tmp_path.iterdir()) == []


def test_a_truncated_image_ends_with_exit_code_3_before_anything_is_trained(tmp_path: Path) -> None:
    scene = tmp_path / "broken"
    shutil.copytree(CORNER, scene)
    image = scene / "test_003" / "normal.png"
    image.write_bytes(image.read_bytes()[:-40])
    done = program("run", "ablations", "--scenes", "broken", "--preset", "smoke", folder=tmp_path)
    assert done.returncode == 3
    assert "normal.png" in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.rglob("*.pt"))


@pytest.mark.parametrize("name", [name for name, suite in SUITES.items() if suite.download])
def test_a_suite_with_missing_scenes_states_their_source_and_how_to_name_them(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", name]) == 3
    said = capsys.readouterr().err
    suite = SUITES[name]
    assert all(scene in said for scene in suite.scenes[:8])
    assert suite.download in said
    assert f"radiogs-bench run {name} --scenes PATH/{suite.scenes[0]}," in said
    assert list(tmp_path.iterdir()) == []


def test_a_data_sets_scenes_are_found_where_the_command_is_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, stands_for in zip(
        ("armadillo", "ficus", "hotdog", "lego"), sorted(CORNER.parent.iterdir()), strict=False
    ):
        (tmp_path / name).symlink_to(stands_for)
    assert main(["run", "tensoir", "--preset", "smoke", "--dry-run"]) == 0
    cells = 4 * len(SUITES["tensoir"].rows)
    assert f"{cells} of {cells} cells to run" in capsys.readouterr().out
    (tmp_path / "ficus").unlink()
    assert main(["run", "tensoir", "--preset", "smoke"]) == 3
    assert "scenes that are not here: ficus\n" in capsys.readouterr().err
    assert main(["run", "tensoir", "--preset", "smoke", "--dry-run", "--seeds", "2"]) == 0
    said = capsys.readouterr().out
    assert f": {2 * cells} cells of preset smoke, into out/tensoir (new)" in said.splitlines()[0]
    assert "not here: ficus." in said
    assert "datasets fetch tensoir --data ROOT" in said


TABLES = (
    "tensoir", "synthetic4relight", "ablations", "strategies", "indirect", "views", "init", "ng", "ns", "relight-cost",
    "efficiency", "mipnerf360-ng", "mipnerf360-ns",
)  # fmt: skip
"""The suites of the paper's thirteen tables."""

ROOMS = ("mipnerf360", "mipnerf360-ng")
"""A data set and a suite that has its scenes."""


@pytest.fixture
def published_data(tmp_path: Path) -> Path:
    """A root of data with stand-ins of the names that the data sets' scenes have; several have a hotdog."""
    root = tmp_path / "data"
    for data_set, suite in (("tensoir",) * 2, ("tensoir-ind", "tensoir"), ("synthetic4relight",) * 2, ROOMS):
        (root / data_set).mkdir(parents=True)
        for name, stands_for in zip(SUITES[suite].scenes, sorted(CORNER.parent.iterdir()), strict=False):
            (root / data_set / name).symlink_to(stands_for)
    return root


@pytest.mark.slow
@pytest.mark.parametrize("suite", TABLES)
def test_every_published_table_is_planned_by_one_command_on_its_own_data_set(
    suite: str, published_data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(published_data.parent)
    plan = ["--as-published", "--data", str(published_data), "--dry-run", "--json", "--device", "cuda"]
    assert main(["run", suite, *plan]) == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert sum(event["event"] == "planned" for event in events) == 4 * len(SUITES[suite].rows)


def test_a_published_table_is_planned_on_the_data_set_that_it_is_about(
    published_data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(published_data.parent)
    root, scenes = published_data, SUITES["tensoir"].scenes
    asked = ["run", "views", "--as-published", "--data", str(root)]
    assert main([*asked, "--dry-run", "--json"]) == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    planned = [event["cell"].split()[0] for event in events if event["event"] == "planned"]
    assert sorted(planned) == sorted(scenes * len(SUITES["views"].rows))
    for data_set in ("tensoir-ind", "synthetic4relight"):
        shutil.rmtree(root / data_set)
    assert main(asked) == 3
    assert "needs scenes that are not here: armadillo, ficus, hotdog, lego" in capsys.readouterr().err
    assert main(["run", "forward-parity", "--as-published"]) == 2


def test_a_run_on_a_device_that_is_not_here_is_planned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    asked = ["run", "ablations", "--scenes", "convex", "--preset", "smoke", "--rows", "ours,no-rad", "--device", "cuda"]
    assert main(asked) == 2
    assert "no CUDA device was found" in capsys.readouterr().err
    assert main([*asked, "--dry-run"]) == 0
    assert "2 of 2 cells to run" in capsys.readouterr().out


@pytest.mark.parametrize(("further", "used"), [((), "radiogs"), (("--protocol", "tensoir"), "tensoir")])
def test_a_suite_has_a_protocol_of_its_own_unless_one_is_named(
    further: tuple[str, ...], used: str, fake_run: Callable[..., int], tmp_path: Path
) -> None:
    assert fake_run("tensoir", "--scenes", "corner", "--method", "radiogs", *further) == 0
    assert read_sweep(tmp_path)["protocol"] == used
    assert {result["cell"]["protocol"] for result in Store(tmp_path).results()} == {used}


@pytest.mark.parametrize("command", [["--help"], ["run", "--help"], ["datasets", "list"], ["methods"]])
def test_help_and_names_need_no_slow_imports(command: list[str]) -> None:
    code = (
        "import sys\n"
        "from radiogs_bench.cli import main\n"
        f"assert main({command}) == 0\n"
        "slow = {'torch', 'warp', 'scipy', 'numpy', 'matplotlib', 'cv2', 'pyvista'} & sys.modules.keys()\n"
        "sys.exit(str(slow) if slow else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["run", "ablatoins"], "Did you mean 'ablations'?"),
        (["run"], "no suite was named"),
        (["run", "ablations", "--seeds", "0"], "not a whole number above zero"),
        (["run", "ablations", "--preset", "tin"], "Did you mean 'tiny'?"),
        (["run", "ablations", "--protocol", "defualt"], "Did you mean 'default'?"),
        (["fly"], "Unknown command 'fly'"),
        (["rnu"], "Did you mean 'run'?"),
        (["run", "ablations", "--speed"], "Unknown option: --speed"),
        (["run", "ablations", "--sedes=3"], "Did you mean --seeds?"),
        (["run", "ablations", "--seeds"], "--seeds requires an argument"),
        (["run", "ablations", "--device", "gpu"], "Choose from: 'cpu', 'cuda'"),
        (["datasets", "chekc"], "Did you mean 'check'?"),
        (["datasets", "generate", "corner", "--seed", "1.5"], "'1.5' is not a whole number"),
        (["run", "ablations", "extra"], "there is no place for extra"),
        (["train"], "SCENE requires an argument"),
        (["run", "ablations", "--no-json"], "Unknown option: --no-json"),
    ],
)
def test_a_wrong_command_ends_with_exit_code_2(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    message = capsys.readouterr().err
    assert says in message
    assert message.startswith("error: ")
    assert message.endswith("(exit code 2)\n")


def test_the_version_has_the_commit(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    commit = r"(unknown|[0-9a-f]{12}(, with changes)?)"
    assert re.fullmatch(rf"radiogs-bench {radiogs_bench.__version__}, commit {commit}\n", capsys.readouterr().out)


def test_a_plan_is_announced_before_slow_imports() -> None:
    told = 'lambda self, task, *steps: sys.exit(f\'{task}: {sorted({"torch", "numpy"} & sys.modules.keys())}\')'
    code = "import sys; from radiogs_bench.cli import main; from radiogs_bench.runs.progress import LogProgress as Log"
    run = f"{code}; Log.advance = {told}; main(['run', 'ablations', '--dry-run'])"
    done = subprocess.run([sys.executable, "-c", run], capture_output=True, text=True, check=False)
    assert done.stderr == "planning ablations: []\n"


def test_options_have_their_last_value_and_repeatable_ones_every_value() -> None:
    given = ["--seeds", "2", "--seeds", "3", "--scenes", "a", "--scenes=corner,none", "--set", "a=1", "--set", "b=x,y"]
    with pytest.raises(UsageError, match="value for --set: 'x,y' of b is neither TOML"):
        parsed(app, ["run", "ablations", *given])
    values = values_of(parsed(app, ["run", "ablations", *given[:-1], "b=x", "--out", "null"])[1])
    assert (values["seeds"], values["scenes"], values["out"]) == (3, ("corner", "none"), Path("null"))
    assert values["settings"] == (("a", 1), ("b", "x"))
    old, new = (parsed(app, ["export", "out", name, "x.csv"])[1].arguments for name in ("--file", "--out"))
    assert old == new


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("run abl", "ablations"),
        ("run ablations --see", "--seeds"),
        ("run ablations --preset sm", "smoke small"),
        ("train cor", "corner corner-128 corner.toml"),
        ("status o", "out"),
        ("datasets ch", "check"),
        ("methods svg", "svg-ir svg-ir-public"),
        ("score out --from svg", "svg-ir"),
        ("datasets fetch tens", "tensoir tensoir-ind"),
        ("run ablations --scenes corner,bow", "corner,bowl corner,bowl-128"),
    ],
)
def test_bash_completes_commands_options_names_and_paths(
    words: str, offered: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "corner.toml").touch()
    (tmp_path / "out").mkdir()
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    asked = (
        f"COMP_WORDS=(radiogs-bench {words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); _radiogs_bench;"
        ' echo "${COMPREPLY[@]}"'
    )
    bash = ["bash", "--norc", "-c", f"{script}\n{asked}"]
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        bash, cwd=tmp_path, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == offered.split()


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_get_a_script_that_asks_for_names(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert "long-side" in script
    assert "smoke" in script
    assert "__complete" in script
    assert main(["__complete", "train", "red"]) == 0
    assert "red_white" in capsys.readouterr().out.split()


def test_without_a_command_the_help_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    without = capsys.readouterr()
    assert main(["--help"]) == 0
    assert without == capsys.readouterr()
    assert "Run the cells of a suite" in without.out
    assert "6 something else ended it" in " ".join(without.out.split())


def test_the_suites_are_listed_on_one_screen(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--list"]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert len(listed) == len(SUITES) + 1 < 40
    for suite, line in zip(SUITES.values(), listed, strict=False):
        assert re.fullmatch(rf"{re.escape(suite.name)} +{re.escape(suite.title)}", line)


def test_a_suite_is_described_by_its_rows_columns_and_scenes(capsys: pytest.CaptureFixture[str]) -> None:
    for suite in SUITES.values():
        assert main(["run", suite.name, "--list"]) == 0
        listed = capsys.readouterr().out
        assert listed.startswith(f"{suite.name}: {suite.title}")
        assert f"  rows: {', '.join(row.key for row in suite.rows)}\n" in listed
        assert f"  columns: {', '.join(column.key for column in suite.columns)}\n" in listed
        assert f"  scenes: {', '.join(suite.scenes)}\n" in listed
        assert not suite.download or f"  download: {suite.download}\n" in listed


def test_a_folder_without_a_run_ends_with_exit_code_3(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["status", str(tmp_path)]) == 3
    assert main(["report", str(tmp_path)]) == 3
    assert "no run in" in capsys.readouterr().err


@pytest.fixture
def run(fake_run: Callable[..., int]) -> Callable[..., int]:
    """``radiogs-bench run ablations`` with the fake method, two seeds, into ``tmp_path``."""
    return partial(fake_run, "ablations")


def test_a_run_ends_with_its_table_and_the_place_of_its_reports(
    run: Callable[..., int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "LOGGED_EVERY_SECONDS", 0.0)
    assert run() == 0
    said = capsys.readouterr()
    assert re.search(r"^\S+ no-rad seed 1: fake invert: \d of \d+, about", said.err, re.M), "steps name their cell"
    assert "Detach L_G" in said.out
    assert "paper 37.86" not in said.out, "protocol default has other conventions"
    assert "a run with --protocol radiogs has them beside its own" in " ".join(said.out.split())
    assert f"\nOpen {tmp_path / 'report.html'}: " in said.out
    assert said.err.count("done in") == 10
    assert len(list(Store(tmp_path).results())) == 10


def test_published_values_are_shown_under_their_protocol(
    run: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("--protocol", "radiogs") == 0
    assert "paper 37.86" in capsys.readouterr().out


@pytest.mark.slow
def test_a_second_run_begins_no_cell_and_shows_the_same_table(
    run: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run()
    first = capsys.readouterr().out
    fake_method.begun.clear()
    assert run() == 0
    assert capsys.readouterr().out == first
    assert fake_method.begun == []
    assert main(["report", str(tmp_path)]) == 0
    assert capsys.readouterr().out == first
    paper = ["report", str(tmp_path), "--style", "paper", "--columns"]
    assert main([*paper, "nvs/psnr,seconds"]) == 0
    table = (tmp_path / "paper.tex").read_text()
    assert r"PSNR $\uparrow$ & Training (s) $\downarrow$" in table
    assert "SSIM" not in table
    assert main([*paper, "nvs/pnsr"]) == 2
    assert "Did you mean 'nvs/psnr'?" in capsys.readouterr().err
    assert main(["report", str(tmp_path), "--columns", "nvs/psnr"]) == 2


@pytest.mark.slow
def test_a_run_is_compared_with_another_of_the_same_protocol_and_rows(
    run: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run()
    report = ["report", str(tmp_path), "--no-pictures"]
    before = shutil.copytree(tmp_path, tmp_path.with_name("before"))
    assert main([*report, "--beside", str(before)]) == 0
    said = capsys.readouterr().out
    assert "Other run: before (" in said
    assert "equal to the last bit: NVS PSNR" in said
    assert "equal" in (tmp_path / "tables" / "beside.md").read_text()
    assert main([*report, "--beside", str(tmp_path / "missing")]) == 3
    other = tmp_path.with_name("other")
    assert run("--rows", "no-rad", "--protocol", "radiogs", "--out", str(other)) == 0
    assert main([*report, "--beside", str(other)]) == 2
    assert "under metric protocol radiogs" in capsys.readouterr().err
    shutil.rmtree(before / "cells")
    assert main([*report, "--beside", str(before)]) == 2
    assert "no finished cell of the same row" in capsys.readouterr().err
    assert main(report) == 0
    assert not (tmp_path / "tables" / "beside.md").exists()


def keys_planned(capsys: pytest.CaptureFixture[str], *how: str) -> set[str]:
    capsys.readouterr()
    arguments = ["run", "ablations", "--scenes", "convex", "--preset", "smoke", "--dry-run", "--json"]
    assert main([*arguments, *how]) == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    return {event["key"] for event in events if event["event"] == "planned"}


@pytest.mark.slow
def test_smaller_images_are_other_cells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    plans = [keys_planned(capsys, *how) for how in ((), ("--long-side", "41"), ("--reduce", "2"), ("--reduce", "1"))]
    assert all(len(plan) >= 5 for plan in plans)
    for one, other in ((0, 1), (0, 2), (1, 2)):
        assert plans[one].isdisjoint(plans[other])
    assert plans[3] == plans[0]


@pytest.mark.parametrize("how", [(), ("--json",)])
def test_repairs_of_a_scene_are_printed_before_anything_runs(
    how: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    asked = ["run", "ablations", "--preset", "smoke", "--dry-run", *how]
    assert main([*asked, "--scenes", "convex", "--reduce", "2"]) == 0
    repairs = load_scene("convex", options=SceneOptions(reduce=2)).repairs
    assert repairs
    lines = capsys.readouterr().out.splitlines()
    told = [json.loads(line)["text"] for line in lines[: len(repairs)]] if how else lines[1 : len(repairs) + 1]
    assert told == [f"convex: {repair}" for repair in repairs]


def test_a_dry_run_prints_resolvable_differences_and_needed_seeds(
    run: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("--dry-run") == 0
    assert "The smallest differences that it could show are not known" in capsys.readouterr().out
    assert run("--seeds", "2") == 0
    capsys.readouterr()
    assert run("--seeds", "3", "--dry-run", "--difference", "nvs/psnr=0.5") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "in four of five such runs: NVS PSNR" in said
    assert "To resolve 0.50 dB of NVS PSNR in four of five runs: 2 seeds on as many scenes as now." in said


def test_a_difference_in_no_column_or_of_no_size_is_refused(run: Callable[..., int]) -> None:
    assert run("--dry-run", "--difference", "beauty/psnr=1") == 2
    for text in ("nvs/psnr", "nvs/psnr=-1", "nvs/psnr=nan", "nvs/psnr=inf"):
        assert run("--dry-run", "--difference", text) == 2


def test_a_dry_run_writes_nothing(run: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--dry-run") == 0
    said = capsys.readouterr().out
    first, second, third, *_ = said.splitlines()
    size = "ablations: 1 scene x 5 rows x 2 seeds: 10 cells of preset smoke"
    assert first == f"{size}, into {tmp_path} (new). A dry run trains nothing."
    assert (second, third[:34]) == ("10 of 10 cells to run", "time, one after the other: unknown")
    assert list(tmp_path.iterdir()) == []
    run()
    capsys.readouterr()
    assert run("--dry-run") == 0
    assert f"{size}, into {tmp_path} (continued). A dry run trains nothing.\n0 of 10 cells" in capsys.readouterr().out


@pytest.mark.slow
def test_a_failing_cell_is_shown_and_decides_the_exit_code(
    run: Callable[..., int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    good = fake_method.evaluate

    def bad(bench: Any, cell: Any, *rest: Any) -> Any:
        if cell.seed == 1 and cell.variant.detach == "pbr":
            raise NumericalFailure("the image is not finite", "A NaN.", "Look.")
        return good(bench, cell, *rest)

    monkeypatch.setattr(fake_method, "evaluate", bad)
    assert run() == 4
    said = capsys.readouterr()
    assert "error: the image is not finite" in said.err
    assert said.err.count("done in") == 9
    assert main(["status", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "failed: the image is not finite" in out
    assert "9 of 10 cells finished" in out
    monkeypatch.setattr(fake_method, "evaluate", good)
    assert run() == 0


def test_ctrl_c_ends_with_exit_code_130_and_the_next_run_continues(
    run: Callable[..., int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    good = fake_method.evaluate

    def interrupted(*arguments: Any) -> Any:
        os.kill(os.getpid(), signal.SIGINT)
        return good(*arguments)

    monkeypatch.setattr(fake_method, "evaluate", interrupted)
    assert run() == 130
    assert capsys.readouterr().err.endswith(
        "Run the same command again: it continues where this run stopped.\n(exit code 130)\n"
    )
    monkeypatch.setattr(fake_method, "evaluate", good)
    fake_method.begun.clear()
    assert run() == 0
    assert "initialise radiometric 0" not in fake_method.begun  # done before the stop
    assert "initialise nvs 0" in fake_method.begun
    assert read_sweep(tmp_path)["seeds"] == [0, 1]


def test_scenes_are_generated_like_the_miniatures_by_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(
        generate, "generate_scene", lambda name, folder, seed, progress, pictures: asked.append(pictures)
    )
    assert main(["datasets", "generate", "corner", "--out", str(tmp_path)]) == 0
    assert main(["datasets", "generate", "corner", "--out", str(tmp_path), "--size", "12", "--depth", "3"]) == 0
    assert asked == [generate.Pictures(), generate.Pictures(size=12, depth=3)]


def test_two_scenes_of_one_name_are_refused(run: Callable[..., int], capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--scenes", "a/sphere,b/sphere") == 2
    assert "two scenes are called 'sphere'" in capsys.readouterr().err


def test_scenes_are_listed_and_checked(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["datasets", "list"]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if "corner" in line)
    for told in ("single effects", "48 + 8", "96 x 96", "this project", "Apache-2.0", "tuned on"):
        assert told in line
    assert main(["datasets", "list", "--json"]) == 0
    assert {*json.loads(capsys.readouterr().out)} == {*radiogs_datasets.scene_names()}
    assert main(["datasets", "check", "corner"]) == 0
    assert "48 training and 8 test views" in capsys.readouterr().out
    assert main(["datasets", "check", "nowhere"]) == 3


def test_seeds_beyond_bounds_are_refused_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    """Audit M33: --seeds 99999999 --dry-run listed cells until memory was full."""
    assert main(["run", "ablations", "--seeds", "99999999", "--dry-run"]) == 2
    assert "1 to 10000" in capsys.readouterr().err
