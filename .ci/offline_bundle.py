"""Lays all that is needed beside Python and PyTorch into out/offline, for a machine that reaches no network.

Wheels of the locked versions in parts of at most 50 MiB, and ``install.sh``, which joins them and makes the project's
virtual environment from them; PyTorch and what CUDA brings are taken from that machine.
"""

import argparse
import hashlib
import re
import shutil
import subprocess
import sys
import tarfile
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
PART_BYTES = 50 * 2**20
GLIBC = (34, 31, 28, 27, 26, 24, 17, 12, 5)
PLATFORMS = (*(f"manylinux_2_{minor}_x86_64" for minor in GLIBC), "manylinux2014_x86_64", "linux_x86_64")

OF_THAT_MACHINE = re.compile(r"(torch|triton|nvidia-.*|cuda-.*)==", re.IGNORECASE)
"""Packages that the other machine has."""

TO_BUILD = ("editables",)
"""Packages that an editable installation needs beside the locked environment."""

INSTALL = """#!/bin/sh
# Run in the project's folder:  sh out/offline/install.sh
set -eu
here=$(CDPATH= cd -- "$(dirname -- "$0")" && pwd)
(cd "$here" && sha256sum -c parts.sha256 && cat wheels.tar.part-* | tar -xf -)
"${PYTHON:-python3}" -m venv --system-site-packages .venv
.venv/bin/python -m pip install --no-index --no-deps "$here"/wheels/*.whl
.venv/bin/python -m pip install --no-index --no-deps --no-build-isolation --editable .
touch .venv/.installed .venv/.ready
"""


def wanted(constraints: str) -> list[str]:
    """Requirements of the locked environment, without those that the other machine has."""
    lines = (line.split("#")[0].strip() for line in constraints.splitlines())
    return [*(line for line in lines if line and not OF_THAT_MACHINE.match(line)), *TO_BUILD]


def downloaded(requirements: Sequence[str], python: str, folder: Path) -> None:
    """Fetch one wheel of each requirement; pip says which there is none of."""
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:"]
    command += ["--python-version", python, *(f"--platform={each}" for each in PLATFORMS)]
    subprocess.run([*command, "--dest", str(folder), *requirements], check=True)


def split(file: Path, most: int = PART_BYTES) -> list[Path]:
    """Cut a file into parts that are joined by ``cat`` in the order of their names; the file itself goes."""
    made = []
    with file.open("rb") as whole:
        for number, content in enumerate(_blocks(whole, most)):
            made.append(file.with_name(f"{file.name}.part-{number:03d}"))
            made[-1].write_bytes(content)
    file.unlink()
    return made


def _blocks(file: object, size: int) -> Iterator[bytes]:
    while content := file.read(size):  # type: ignore[attr-defined]
        yield content


def packed(wheels: Path, out: Path, most: int = PART_BYTES) -> list[Path]:
    """The folder of wheels as parts beside ``install.sh``; returns all files."""
    whole = out / "wheels.tar"
    with tarfile.open(whole, "w") as archive:
        for wheel in sorted(wheels.glob("*.whl")):
            archive.add(wheel, f"wheels/{wheel.name}")
    made = split(whole, most)
    sums = out / "parts.sha256"
    sums.write_text("".join(f"{hashlib.sha256(part.read_bytes()).hexdigest()}  {part.name}\n" for part in made))
    script = out / "install.sh"
    script.write_text(INSTALL)
    return [*made, sums, script]


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the bundle."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", default="3.12", help="of the other machine (default: 3.12)")
    parser.add_argument("--out", type=Path, default=ROOT / "out/offline")
    options = parser.parse_args(arguments)
    wheels = options.out / "download"
    wheels.mkdir(parents=True, exist_ok=True)
    downloaded(wanted((ROOT / "constraints.txt").read_text()), options.python, wheels)
    made = packed(wheels, options.out)
    shutil.rmtree(wheels)
    size = sum(path.stat().st_size for path in made)
    sys.stdout.write(f"wrote {len(made)} files to {options.out}, {size / 2**20:.0f} MiB in all\n")
    sys.stdout.write("Copy the project with that folder; there:  sh out/offline/install.sh && make gpu\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
