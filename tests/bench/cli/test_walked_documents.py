"""README, the list of commands and three pages are walked through, at preset smoke on small images, in order.

Changes to a command are listed here. Commands are not executed that need a network (``datasets fetch``,
``datasets weights``) or a cluster; that the command line takes them is tested in tests/ci.
"""

import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from captured import write_capture
from radiogs_bench.cli import main
from radiogs_bench.suites.experiment import FORWARD_PARITY
from radiogs_bench.suites.registry import SUITES

ROOT = Path(__file__).parents[3]
LIGHT = ROOT / "datasets" / "radiogs_datasets" / "tiny" / "corner" / "envmaps" / "sunset.hdr"
TUTORIALS = [ROOT / "docs" / f"{name}.md" for name in ("datasets", "gpu", "your_method")]
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)

NOT_HERE = re.compile(
    r"datasets (fetch|weights)|--engine ray|^make |path/to/method\.toml|git\+https|install .* dist/|PHOTOS|--start"
)
"""A network, a cluster, what `make test` itself is, a code of somebody's (tests/baselines/commands have one), the
packages that tests/ci/test_wheel.py installs, photographs (test_posing.py), and splats (test_splat_start.py)."""

LISTS = (ROOT / "README.md", ROOT / "docs" / "commands.md")
"""Documents whose commands do not follow from each other."""

WHOLE_SUITES = re.compile(r"^radiogs-bench run (?!stability)(?!.*--(list|dry-run))")
"""Commands of these lists train for hours: one scene of few pixels, and one seed, have the same path."""

WHOLE_DATA_SET = re.compile(r"^radiogs-bench run tensoir (?!.*--dry-run)")
FEWER = "--rows ours,gs-ir --scenes tensoir/lego"
"""Two cells of 36 of a tutorial's data set."""

ALL_ROWS = re.compile(r"^radiogs-bench run ablations (?!.*--(rows|dry-run))")

TAKES_PRESET = re.compile(r"^radiogs-bench (run|train|probe|rehearse)\b(?!.*--list)")

SMALL = "24"
"""Pixels of the long side of the scenes that the walks read."""

NAMED_SCENES = ("corner", "convex", "bowl", "red_white")
DATA_SETS = {"lego": "corner", "hotdog": "bowl", "armadillo": "red_white", "ficus": "niche"}
"""The miniature that replaces each scene of TensoIR."""

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
    here = "pip install --no-build-isolation --target site --quiet"  # the build tool is installed: no index is asked
    command = command.replace("pip install", here).replace(" -e docs/", f" {ROOT}/docs/")
    if TAKES_PRESET.search(command):
        command = re.sub(r"--preset \w+", "", command) + " --preset smoke"
    return command


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the documents take for granted: a capture, a light, data sets, small miniatures by name."""
    folder = tmp_path_factory.mktemp("given")
    write_capture(folder / "capture")
    for name, miniature in {**{name: name for name in NAMED_SCENES}, **DATA_SETS}.items():
        place = f"data/tensoir/{name}" if name in DATA_SETS else f"scenes/{name}"
        run(f"radiogs-bench datasets convert {miniature} --to tensoir --long-side {SMALL} --out {place}", folder)
    shutil.copy(LIGHT, folder / "sky.hdr")
    return folder


@pytest.fixture
def walk(given: Path, tmp_path: Path) -> Path:
    """A copy of the folder for one document."""
    return shutil.copytree(given, tmp_path, dirs_exist_ok=True)


def run(command: str, folder: Path) -> None:
    """Execute a command; it has to succeed without a traceback.

    In this process, which has imported everything; in a process of its own once the example of a method is installed
    (into ``site``), which only a new process finds.
    """
    program, *arguments = shlex.split(command)
    here = program == "radiogs-bench" and not (folder / "site").exists()
    code, out, err = executed_here(arguments, folder) if here else executed_apart(program, arguments, folder)
    said = f"{command}\n{out[-2000:]}\n{err[-3000:]}"
    assert code == 0, said
    assert "Traceback" not in err, said


def executed_here(arguments: list[str], folder: Path) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command of the harness."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(arguments)
    return code, out.getvalue(), err.getvalue()


def executed_apart(program: str, arguments: list[str], folder: Path) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a process that finds what is installed into ``site``."""
    module = {"radiogs-bench": "radiogs_bench", "pip": "pip"}[program]
    paths = [str(folder / "site"), os.environ.get("PYTHONPATH", "")]
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "COLUMNS": "120"},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


def abridged(command: str) -> str:
    """A command of a list on one small scene with one seed, where it would train many.

    The first of its rows is run, and of `ablations`, whose run later commands read, the last, too.
    """
    if not WHOLE_SUITES.search(command):
        return command
    suite = SUITES.get(command.split()[2])
    read_later = suite is not None and suite.name == "ablations" and "--recipe" not in command
    if suite is not None and "--rows" not in command:
        rows = [row.key for row in suite.rows]
        command = f"{command} --rows {','.join((rows[0], rows[-1]) if read_later else rows[:1])}"
    command = re.sub(r"--seeds \d+", "", command)
    if suite is not None and suite.experiment == FORWARD_PARITY:
        return f"{command} --scenes furnace-0.5"
    if "--data" in command:
        return f"{command} --scenes tensoir/lego"
    scored_into = read_later  # by `score FOLDER --scene corner`, which is the whole miniature
    # Suites whose results no later command reads train what they share once.
    small = "" if scored_into else f" --long-side {SMALL} --out out/suites"
    return f"{command}{small}" if "--scenes" in command else f"{command} --scenes corner{small}"


def test_every_command_of_the_readme_and_of_the_list_is_executed(walk: Path) -> None:
    """Models first: other commands take them for granted."""
    listed = [command for document in LISTS for command in commands(document)]
    executed = list(dict.fromkeys(command for each in listed if (command := prepared(each)) is not None))
    assert len(executed) > 25
    executed.sort(key=lambda command: not re.match(r"radiogs-bench (train|render) ", command))
    for command in executed:
        if " gate " in command:
            run(f"{command} --update", walk)
        run(abridged(command), walk)


@pytest.mark.parametrize("document", TUTORIALS, ids=lambda path: path.stem)
def test_the_commands_of_a_page_run_in_order(document: Path, walk: Path) -> None:
    executed = [command for each in commands(document) if (command := prepared(each)) is not None]
    assert len(executed) >= 6
    for command in executed:
        fewer = FEWER if WHOLE_DATA_SET.search(command) else "--rows ours" if ALL_ROWS.search(command) else ""
        run(f"{command} {fewer}", walk)
