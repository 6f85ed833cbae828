"""`make gpu` reports a missing card, keeps the output of each part, and continues where it stopped; and the bundle."""

import json
import subprocess
import sys
import tarfile
from pathlib import Path
from types import ModuleType

import pytest
import torch

from ci_scripts import script

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def check() -> ModuleType:
    return script("gpu_check")


@pytest.fixture(scope="module")
def bundle() -> ModuleType:
    return script("offline_bundle")


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a card")
def test_without_a_card_it_reports_that(check: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert check.main(["--work", str(tmp_path / "work")], docs=tmp_path / "docs") == 2
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "error: there is no CUDA device"
    assert said[2].startswith("Run it on a machine with a card")
    assert not (tmp_path / "docs").exists()


def test_parts_are_kept_gone_on_with_and_reported(check: ModuleType, tmp_path: Path) -> None:
    counted = tmp_path / "counted"
    counts = (sys.executable, "-c", f"open({str(counted)!r}, 'a').write('x'); print('all is well')")
    listed = [
        check.Part("first", "that it counts", counts),
        check.Part("second", "that it is tried again", (sys.executable, "-c", "import sys; print('no'); sys.exit(3)")),
        check.Part("third", "that it is left out", counts, needs="no-such-program"),
    ]
    given = ["--device", "cpu", "--work", str(tmp_path / "work")]
    assert check.main(given, listed, tmp_path / "docs") == 1
    assert check.main(given, listed, tmp_path / "docs") == 1
    assert counted.read_text() == "x", "what has passed is not run again"
    assert check.main([*given, "--again", "--only", "first"], listed, tmp_path / "docs") == 1
    assert counted.read_text() == "xx"
    (document,) = (tmp_path / "docs").iterdir()
    text = document.read_text()
    assert "| first | that it counts | passed |" in text
    assert "| second | that it is tried again | failed |" in text
    assert "left out: there is no no-such-program" in text
    assert "all is well" in text
    assert torch.__version__ in text


def test_a_part_that_takes_too_long_is_stopped_and_not_called_passed(check: ModuleType, tmp_path: Path) -> None:
    sleeper = check.Part(
        "long", "nothing", (sys.executable, "-c", "import time; print('begun', flush=True); time.sleep(60)")
    )
    outcome = check.run_part(sleeper, tmp_path / "long.json", limit=4.0)
    assert outcome["state"] == "stopped"
    assert outcome["seconds"] < 30
    assert json.loads((tmp_path / "long.json").read_text())["said"] == ["begun"]


def test_its_commands_are_ones_that_the_program_has(check: ModuleType, tmp_path: Path) -> None:
    for part in check.parts("cpu", tmp_path):
        command = list(part.command)
        if "radiogs_bench" in command:
            program, options = command[:3], command[3:]
            place = next(at for at, word in enumerate(options) if word.startswith("--"))
            words = [
                word for word in options[:place] if word in ("bench", "train", "rehearse", "run", "kernels", "frames")
            ]
            done = subprocess.run([*program, *words, "--help"], capture_output=True, text=True, check=True)
            for word in options:
                assert not word.startswith("--") or word in done.stdout, (part.name, word)


def test_a_bundle_has_everything_but_pytorch_and_comes_together_again(bundle: ModuleType, tmp_path: Path) -> None:
    wanted = bundle.wanted((ROOT / "constraints.txt").read_text())
    assert any(line.startswith("warp-lang==") for line in wanted)
    assert any(line.startswith("torchmetrics==") for line in wanted)
    assert "editables" in wanted
    assert not [line for line in wanted if line.startswith(("torch==", "triton", "nvidia-"))]
    wheels = tmp_path / "download"
    wheels.mkdir()
    contents = {f"one-{place}-py3-none-any.whl": bytes([place]) * 700 for place in range(4)}
    for name, content in contents.items():
        (wheels / name).write_bytes(content)
    made = bundle.packed(wheels, tmp_path, most=1024)
    parts = [path for path in made if ".part-" in path.name]
    assert len(parts) > 3
    assert all(path.stat().st_size <= 1024 for path in parts)
    joined = tmp_path / "joined.tar"
    joined.write_bytes(b"".join(path.read_bytes() for path in sorted(parts)))
    with tarfile.open(joined) as archive:
        for name, content in contents.items():
            found = archive.extractfile(f"wheels/{name}")
            assert found is not None
            assert found.read() == content
    checked = subprocess.run(["sha256sum", "-c", "parts.sha256"], cwd=tmp_path, capture_output=True, check=False)
    assert checked.returncode == 0
    subprocess.run(["sh", "-n", str(tmp_path / "install.sh")], check=True)
