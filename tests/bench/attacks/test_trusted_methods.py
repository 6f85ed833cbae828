"""A method's file runs only where the command line names it: folders of results and suites of strangers do not."""

import json
import pickle
from pathlib import Path

import pytest

import radiogs_bench as rb
from public_outputs import WRITERS, noisy
from radiogs_bench.cli import main
from radiogs_bench.methods import FoundMethods, method
from radiogs_bench.trusted_methods import trusting
from radiogs_core.errors import UsageError
from radiogs_datasets.image_files import write_exr

METHOD = """
name = "innocent"
title = "Innocent"
reader = "radiogs"
results = "{output}"
layouts = ["tensoir"]
working_folder = "{output}"
[code]
url = "https://example.org/x"
commit = "0123456"
licence = "MIT"
folder = "."
[environment]
TURNED = "a\\u202eb"
[[train]]
name = "train"
arguments = ["/bin/sh", "-c", "TRAINS"]
writes = ["{output}"]
"""
RENDER = '[render]\narguments = ["/bin/sh", "-c", "echo > PLACE/PWNED; exit 1"]\n'

SUITE = """
name = "mine"
title = "Mine"
reference = "a"
columns = ["nvs/psnr"]
[[rows]]
key = "a"
text = "A"
method = "evil.toml"
"""


def put_method(folder: Path, trains: str, render: str = "") -> None:
    """Write evil.toml; PLACE is replaced by its folder."""
    text = METHOD.replace("TRAINS", trains) + render
    (folder / "evil.toml").write_text(text.replace("PLACE", str(folder)))


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a model that evil.toml has made; to render it writes PWNED."""
    monkeypatch.chdir(tmp_path)
    put_method(tmp_path, "echo model > {output}/model.pth", RENDER)
    words = ["train", "convex", "--method", "evil.toml", "--preset", "smoke", "--out", "model", "--no-score"]
    assert main(words) == 0
    return tmp_path


LIGHT = ["--envmap", "light.exr"]


@pytest.mark.parametrize(
    "words",
    [
        ["render", "model"],
        ["render", "model", "--trust", "other.toml"],
        ["score", "model"],
        ["relight", "model", *LIGHT],
        ["export", "model", "--layout-of", "irgs"],
        ["export", "model", "--mesh"],
        ["probe", "model"],
        ["run", "suite.toml", "--scenes", "convex", "--preset", "smoke"],
        ["run", "suite.toml", "--list"],
        ["rehearse", "suite.toml", "--scenes", "convex"],
    ],
)
def test_files_named_only_by_folders_or_suites_are_not_run(
    words: list[str], place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Attack model_folder_runs_toml: the commands of evil.toml ran silently."""
    (place / "suite.toml").write_text(SUITE)
    (place / "other.toml").write_bytes((place / "evil.toml").read_bytes())
    write_exr(place / "light.exr", next(iter(rb.load_scene("convex").lights.values())).radiance.numpy())
    assert main(words) == 2
    said = capsys.readouterr().err
    assert "evil.toml' is a method's file, which this command does not name" in said
    assert "--trust evil.toml" in said
    assert not (place / "PWNED").exists()


def test_a_model_is_looked_at_without_its_method(place: Path) -> None:
    assert main(["view", "model"]) == 3  # it has no surfels
    assert not (place / "PWNED").exists()


@pytest.mark.parametrize("other", ["evil\0.toml", "evil\x1b[2J\n.toml"])
def test_a_name_that_is_no_path_is_shown_and_not_followed(other: str) -> None:
    with trusting([]), pytest.raises(UsageError) as refused:
        method(other)
    assert refused.value.what.isprintable()
    assert refused.value.remedy.endswith("--trust FILE")


def test_from_python_a_model_needs_its_file_named_too(place: Path) -> None:
    with pytest.raises(UsageError, match="does not name"):
        rb.open_model("model")
    assert rb.method("evil.toml").name == "innocent"
    with pytest.raises(UsageError, match="does not name"):
        rb.open_model("model")  # naming it once is no trust for later
    assert rb.open_model("model", trust=place / "evil.toml").method == "innocent"
    assert not (place / "PWNED").exists()


def test_a_trusted_file_runs_after_its_commands_were_printed(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "model", "--trust", f"{place / 'evil.toml'}"]) == 1
    said = capsys.readouterr().err
    assert (place / "PWNED").exists()
    assert f"  render: /bin/sh -c 'echo > {place}/PWNED; exit 1'\n" in said
    assert r"with TURNED: 'a\u202eb'" in said
    (place / "PWNED").unlink()
    assert main(["render", "model"]) == 2  # trust ends with the command
    assert not (place / "PWNED").exists()


def test_a_suite_of_a_trusted_file_is_run(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (place / "suite.toml").write_text(SUITE)
    words = ["run", "suite.toml", "--scenes", "convex", "--preset", "smoke", "--dry-run"]
    for option in ("--trust", "--method"):
        assert main([*words, option, "evil.toml"]) == 0
    assert capsys.readouterr().err.count("evil.toml is trusted and may run:") == 1


def test_a_file_that_changes_after_it_was_named_is_not_read_again(place: Path) -> None:
    with trusting(["evil.toml"]):
        (place / "evil.toml").write_text("changed")
        assert method("evil.toml").title == "Innocent"
    with pytest.raises(UsageError, match="does not name"):
        method("evil.toml")


def test_a_link_to_a_trusted_file_runs_in_the_folder_of_the_file(place: Path) -> None:
    """A stranger's link must not bring the stranger's code under the user's commands."""
    (place / "model" / "mine.toml").symlink_to(place / "evil.toml")
    with trusting(["evil.toml"]) as read:
        assert method("model/mine.toml") is read[place / "evil.toml"]


def test_worker_processes_trust_the_files_named_by_the_run(place: Path) -> None:
    with trusting(["evil.toml"]):
        sent = pickle.dumps(FoundMethods())
    assert pickle.loads(sent)("evil.toml").name == "innocent"
    with pytest.raises(UsageError, match="does not name"):
        pickle.loads(pickle.dumps(FoundMethods()))("evil.toml")


def test_results_are_read_without_the_file_of_their_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    WRITERS["radiogs"](tmp_path / "shelf", noisy(rb.load_scene("convex")))
    put_method(tmp_path, "cp -r PLACE/shelf/. {output}; touch {output}/x")
    words = ["run", "synthetic4relight", "--preset", "smoke", "--scenes", "convex", "--protocol", "default"]
    assert main([*words, "--method", "evil.toml", "--out", "out"]) == 0
    put_method(tmp_path, "echo > PLACE/PWNED", RENDER)
    gate = "gate out --baseline baseline.json --update"
    for command in ("report out --no-pictures", "status out", "verify out", gate, "export out --to csv"):
        assert main(command.split()) == 0, command
    assert not (tmp_path / "PWNED").exists()
    assert "Innocent" in (tmp_path / "out" / "synthetic4relight.md").read_text()
    assert "innocent" in {json.loads(each.read_text())["cell"]["method"] for each in Path("out/cells").glob("*.json")}
