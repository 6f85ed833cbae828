"""README, the list of commands and the tutorials are walked through, at preset smoke on small images, in order.

Changes to a command are listed here. Commands are not executed that need a network (``datasets fetch``,
``datasets weights``) or a cluster; that the command line takes them is tested in tests/ci.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from captured import write_capture
from radiogs_bench.suites.experiment import FORWARD_PARITY
from radiogs_bench.suites.registry import SUITES

ROOT = Path(__file__).parents[2]
LIGHT = ROOT / "datasets" / "radiogs_datasets" / "tiny" / "corner" / "envmaps" / "sunset.hdr"
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)

NOT_HERE = re.compile(r"datasets (fetch|weights)|--engine ray|^make |path/to/method\.toml")
"""A network, a cluster, what `make test` itself is, and a code of somebody's (tests/baselines/commands have one)."""

LISTS = (ROOT / "README.md", ROOT / "docs" / "commands.md")
"""Documents whose commands do not follow from each other."""

WHOLE_SUITES = re.compile(r"^radiogs-bench run (?!stability)(?!.*--(list|dry-run))")
"""Commands of these lists train for hours: one scene of few pixels, and one seed, have the same path."""

TAKES_PRESET = re.compile(r"^radiogs-bench (run|train|probe|rehearse)\b(?!.*--list)")

SMALL = "24"
"""Pixels of the long side of the scenes that the walks read."""

NAMED_SCENES = ("corner", "convex", "bowl", "red_white")
DATA_SETS = {"lego": "corner", "hotdog": "bowl", "armadillo": "red_white", "ficus": "niche"}
"""The miniature that stands for each scene of TensoIR."""

pytestmark = pytest.mark.slow


def commands(document: Path) -> list[str]:
    """Every command of a document's shell blocks, in order, without its comment."""
    found = []
    for block in BLOCK.findall(document.read_text()):
        for line in block.replace("\\\n", " ").splitlines():
            command = re.split(r"\s#", line)[0].strip()
            if command:
                found.append(command.removeprefix(".venv/bin/"))
    return found


def prepared(command: str) -> str | None:
    """The command as it is executed here; None for what is not."""
    if NOT_HERE.search(command):
        return None
    command = command.replace("--device cuda", "--device cpu").replace("HOST:6379", "")
    command = re.sub(r"\bPATH\b", "scenes/corner", command)
    command = re.sub(r"\bFOLDER\b", "out/corner/render", command)
    command = re.sub(r"\bNAME\b", "'a row'", command)
    command = re.sub(r"\bROOT\b", "data", command)
    command = command.replace("path/to/suite.toml", f"{ROOT / 'docs/examples/rays_or_surfels.toml'} --rows ours")
    command = command.replace("pip install", "pip install --target site --quiet").replace(" -e docs/", f" {ROOT}/docs/")
    if TAKES_PRESET.search(command):
        command = re.sub(r"--preset \w+", "", command) + " --preset smoke"
    return command


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    """A folder with what the documents take for granted: a capture, a light, data sets, small miniatures by name."""
    write_capture(tmp_path / "capture")
    environment = environment_of(tmp_path)
    for name, miniature in {**{name: name for name in NAMED_SCENES}, **DATA_SETS}.items():
        place = f"data/tensoir/{name}" if name in DATA_SETS else f"scenes/{name}"
        run(
            f"radiogs-bench datasets convert {miniature} --to tensoir --long-side {SMALL} --out {place}",
            tmp_path,
            environment,
        )
    shutil.copy(LIGHT, tmp_path / "sky.hdr")
    return tmp_path


def environment_of(folder: Path) -> dict[str, str]:
    """The example of a method is installed into ``site``; the rest is the environment of the tests."""
    paths = [str(folder / "site"), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "COLUMNS": "120"}


def run(command: str, folder: Path, environment: dict[str, str]) -> None:
    """Execute a command; it has to end well, and without a traceback."""
    program, *arguments = shlex.split(command)
    module = {"radiogs-bench": "radiogs_bench", "pip": "pip"}[program]
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    said = f"{command}\n{done.stdout[-2000:]}\n{done.stderr[-3000:]}"
    assert done.returncode == 0, said
    assert "Traceback" not in done.stderr, said


def abridged(command: str) -> str:
    """A command of a list on one small scene with one seed, where it would train many.

    The first of its rows is run, and of `ablations`, whose run later commands read, the last, too.
    """
    if not WHOLE_SUITES.search(command):
        return command
    suite = SUITES.get(command.split()[2])
    if suite is not None and "--rows" not in command:
        rows = [row.key for row in suite.rows]
        command = f"{command} --rows {','.join((rows[0], rows[-1]) if suite.name == 'ablations' else rows[:1])}"
    command = re.sub(r"--seeds \d+", "", command)
    if suite is not None and suite.experiment == FORWARD_PARITY:
        return f"{command} --scenes furnace-0.5"
    if "--data" in command:
        return f"{command} --scenes tensoir/lego"
    scored_into = "ablations" in command  # by `score FOLDER --scene corner`, which is the whole miniature
    small = "" if scored_into else f" --long-side {SMALL}"
    return f"{command}{small}" if "--scenes" in command else f"{command} --scenes corner{small}"


def test_every_command_of_the_readme_and_of_the_list_is_executed(walk: Path) -> None:
    """Models first: other commands take them for granted."""
    environment = environment_of(walk)
    given = [command for document in LISTS for command in commands(document)]
    executed = list(dict.fromkeys(command for each in given if (command := prepared(each)) is not None))
    assert len(executed) > 25
    executed.sort(key=lambda command: not re.match(r"radiogs-bench (train|render) ", command))
    for command in executed:
        if " gate " in command:
            run(f"{command} --update", walk, environment)
        run(abridged(command), walk, environment)


@pytest.mark.parametrize("document", TUTORIALS, ids=lambda path: path.stem)
def test_the_commands_of_a_tutorial_run_in_order(document: Path, walk: Path) -> None:
    environment = environment_of(walk)
    executed = [command for given in commands(document) if (command := prepared(given)) is not None]
    assert len(executed) >= 6
    for command in executed:
        run(command, walk, environment)
