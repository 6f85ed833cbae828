"""A wheel and a source distribution are whole: kernels' C++, scenes, published tables and templates come with them."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]

LARGEST = 40 * 10**6
"""Bytes that a wheel or a source distribution may have; scenes take 33 million of them."""

Built = Mapping[str, Path]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """The source distribution, and the wheel that is built from nothing but what it holds."""
    folder = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "hatchling", "build", "--directory", str(folder), "--target"]
    subprocess.run([*build, "sdist"], cwd=ROOT, check=True, capture_output=True)
    (source,) = folder.glob("*.tar.gz")
    (folder / "unpacked").mkdir()
    subprocess.run(["tar", "-xf", source, "-C", folder / "unpacked"], check=True)  # tarfile's filter is 3.11.4's
    (unpacked,) = (folder / "unpacked").iterdir()
    subprocess.run([*build, "wheel"], cwd=unpacked, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    return {"source distribution": source, "wheel": wheel}


def test_the_wheel_holds_every_file_of_the_packages(built: Built) -> None:
    with zipfile.ZipFile(built["wheel"]) as archive:
        packed = set(archive.namelist())
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    packages = [ROOT / package for package in settings["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]]
    files = {
        path.relative_to(package.parent).as_posix()
        for package in packages
        for path in package.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert len({name for name in files if name.endswith(".inl")}) > 20
    assert files - packed == set()
    assert max(file.stat().st_size for file in built.values()) < LARGEST


@pytest.fixture(scope="module")
def fresh(built: Built, tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, str]:
    """Variables of an environment in which the wheel is installed, and no checkout is found.

    A .pth file lends it the dependencies of this one; ``make packages`` installs them anew.
    """
    folder = tmp_path_factory.mktemp("fresh")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    (site,) = folder.glob("lib/python*/site-packages")
    paths = sysconfig.get_paths()
    (site / "dependencies.pth").write_text(f"{paths['purelib']}\n{paths['platlib']}\n")
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    installed(folder, variables, built["wheel"])
    return variables | {"PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}", "VIRTUAL_ENV": str(folder)}


def installed(environment: Path, variables: Mapping[str, str], *what: Path) -> None:
    """Install what needs no index, in the place of what is there."""
    pip = [sys.executable, "-m", "pip", "--python", environment / "bin" / "python", "install", "--quiet"]
    options = ("--no-index", "--no-deps", "--no-build-isolation", "--ignore-installed", "--disable-pip-version-check")
    subprocess.run([*pip, *options, *what], env=variables, check=True)


@pytest.mark.slow
def test_a_model_is_trained_where_there_is_no_checkout(fresh: Mapping[str, str], tmp_path: Path) -> None:
    """By the wheel, which is what pip builds of the source distribution, too."""
    train = ["radiogs-bench", "train", "corner", "--preset", "smoke", "--out", "model"]
    done = subprocess.run(train, cwd=tmp_path, env=fresh, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "model" / "surfels.ply").is_file()
    find = "import radiogs, radiogs_core, radiogs_datasets, radiogs_bench as bench; print(bench.__file__)"
    found = subprocess.run(["python", "-c", find], cwd=tmp_path, env=fresh, capture_output=True, text=True, check=True)
    assert Path(found.stdout.strip()).is_relative_to(fresh["VIRTUAL_ENV"])


@pytest.mark.slow
def test_the_gate_of_another_repository_s_method_passes_and_stops_a_worse_one(
    fresh: Mapping[str, str], tmp_path: Path
) -> None:
    """The recipe of docs/reliability.md and then its workflow, step by step, with the wheel in place of a Git address.

    Two seeds of few pixels take the place of eight of all.
    """
    shutil.copytree(ROOT / "docs/examples/own_method", tmp_path, dirs_exist_ok=True)
    project, method = tmp_path / "pyproject.toml", tmp_path / "mean_image" / "method.py"
    project.write_text(project.read_text().replace("\nmean-image = ", "\nmine = "))
    method.write_text(method.read_text().replace('name = "mean-image"', 'name = "mine"'))
    subprocess.run(["git", "init", "--quiet"], cwd=tmp_path, check=True)
    (tmp_path / ".github").mkdir()

    def step(line: str) -> "subprocess.CompletedProcess[str]":
        if line.startswith("pip install "):
            line = "true"
            installed(Path(fresh["VIRTUAL_ENV"]), fresh, tmp_path)
        line = line.replace("--seeds 8", "--seeds 2 --long-side 24")
        return subprocess.run(
            ["bash", "-ec", line], cwd=tmp_path, env=fresh, capture_output=True, text=True, check=False
        )

    block = (ROOT / "docs/reliability.md").read_text().split("```sh\n")[2].split("```")[0]
    for line in (line for line in block.splitlines() if not line.startswith("#")):
        done = step(line)
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
    assert "no worse than the baseline, and computed alike" in done.stdout
    sound = '{"mean": self.total'
    assert method.read_text().count(sound) == 1
    method.write_text(method.read_text().replace(sound, '{"mean": 0.5 * self.total'))
    workflow = yaml.safe_load((ROOT / "docs/examples/own_method_gate.yml").read_text())
    *_, compared = [step(each["run"]) for each in workflow["jobs"]["gate"]["steps"] if "run" in each]
    assert compared.returncode == 1, f"{compared.stdout}{compared.stderr}"
    assert "nvs/psnr worse by" in compared.stdout
