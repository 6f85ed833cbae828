"""A wheel and a source distribution are whole: kernels' C++, scenes, published tables and templates come with them."""

import os
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest

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


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["wheel", "source distribution"])
def test_a_model_is_trained_where_there_is_no_checkout(kind: str, built: Built, tmp_path: Path) -> None:
    """A .pth file lends the new environment the dependencies of this one; ``make packages`` installs them anew."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / "fresh"], check=True)
    (site,) = (tmp_path / "fresh").glob("lib/python*/site-packages")
    paths = sysconfig.get_paths()
    (site / "dependencies.pth").write_text(f"{paths['purelib']}\n{paths['platlib']}\n")
    python = tmp_path / "fresh" / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--disable-pip-version-check"]
    options = ("--no-index", "--no-deps", "--no-build-isolation", "--ignore-installed")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    subprocess.run([*pip, *options, built[kind]], env=environment, check=True)
    empty = tmp_path / "empty"
    empty.mkdir()
    train = [python.with_name("radiogs-bench"), "train", "corner", "--preset", "smoke", "--out", "model"]
    done = subprocess.run(train, cwd=empty, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (empty / "model" / "surfels.ply").is_file()
    find = "import radiogs, radiogs_core, radiogs_datasets, radiogs_bench as bench; print(bench.__file__)"
    found = subprocess.run([python, "-c", find], cwd=empty, env=environment, capture_output=True, text=True, check=True)
    assert Path(found.stdout.strip()).is_relative_to(site)
