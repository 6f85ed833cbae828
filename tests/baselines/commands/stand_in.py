"""A fake public code: it reads a scene's cameras and lays out prepared results.

It has the three scripts of its kind (train, render, relight) and every requested bad habit. Only Python's own library
is used, so that it starts at once.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from argparse import ArgumentParser, Namespace
from pathlib import Path


def main() -> None:
    parser = ArgumentParser()
    parser.add_argument("script", choices=["train", "render", "relight"])
    parser.add_argument("--scene", type=Path, required=True)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--pantry", type=Path)
    parser.add_argument("--name", default="model")
    parser.add_argument("--light", default="")
    parser.add_argument("--light_file", type=Path)
    parser.add_argument("--lights", nargs="*", default=[])
    parser.add_argument("--share", type=float, default=1)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--habit", default="")
    parser.add_argument("--note", type=Path)
    parser.add_argument("--size", type=int, default=1000)
    arguments = parser.parse_args()
    frames = json.loads((arguments.scene / "transforms_test.json").read_text())["frames"]
    say(f"{arguments.script}: {len(frames)} test views")
    if arguments.note is not None:
        with arguments.note.open("a") as file:
            file.write(" ".join(sys.argv[1:]) + "\n")
    {"train": train, "render": render, "relight": relight}[arguments.script](arguments)


def say(line: str) -> None:
    sys.stdout.write(line + "\n")


def train(arguments: Namespace) -> None:
    behave(arguments)
    arguments.output.mkdir(parents=True, exist_ok=True)
    kept = "resumed " if arguments.resume else ""
    (arguments.output / f"{arguments.name}.pth").write_text(kept + "x" * arguments.size)


def render(arguments: Namespace) -> None:
    behave(arguments)
    lay_out(arguments, [path for path in entries(arguments.pantry) if not is_relit(path)])


def relight(arguments: Namespace) -> None:
    behave(arguments)
    assert arguments.light_file is None or arguments.light_file.read_bytes()
    lights = arguments.lights or [arguments.light]
    lay_out(arguments, [path for path in entries(arguments.pantry) if any(light in str(path) for light in lights)])


def entries(pantry: Path) -> list[Path]:
    return sorted(path.relative_to(pantry) for path in pantry.rglob("*") if path.is_file())


def is_relit(path: Path) -> bool:
    return "relight" in str(path) or "relit" in str(path) or "rli" in str(path)


def lay_out(arguments: Namespace, paths: list[Path]) -> None:
    for number, path in enumerate(paths):
        if number >= arguments.share * len(paths):
            break
        target = arguments.output / path
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(arguments.pantry / path, target)
    if arguments.habit == "cut" and paths:
        cut = arguments.output / paths[-1]
        cut.write_bytes(cut.read_bytes()[:-20])


def behave(arguments: Namespace) -> None:
    habit = arguments.habit
    if habit in ("crash", "crash after half"):
        if habit == "crash after half":
            arguments.output.mkdir(parents=True, exist_ok=True)
            (arguments.output / "half.pth").write_text("half")
        sys.stderr.write("RuntimeError: CUDA error: an illegal memory access was encountered\n")
        raise SystemExit(3)
    if habit == "abort":
        os.kill(os.getpid(), signal.SIGKILL)
    if habit == "hang":
        time.sleep(600)
    if habit == "hang deaf":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        time.sleep(600)
    if habit == "hang tidily":
        try:
            signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
            time.sleep(600)
        finally:
            (arguments.output / "tidied").touch()
    if habit == "need to be alone":
        state = Path(f"/proc/{os.environ['STAND_IN_OTHER']}/stat")
        assert not state.exists() or state.read_text().rpartition(")")[2].split()[0] == "Z", "the other is alive"
    if habit == "hang with orphans":
        orphan(arguments, "one")
        orphan(arguments, "two", leave_mark=False)
        time.sleep(600)
    if habit == "crash with orphans":
        orphan(arguments, "one")
        orphan(arguments, "two", leave_mark=False)
        time.sleep(0.6)
        raise SystemExit(3)
    if habit == "leave an orphan":
        orphan(arguments, "one")
    if habit == "fill the disk":
        arguments.output.mkdir(parents=True, exist_ok=True)
        with (arguments.output / "big.pth").open("wb") as file:
            for _ in range(1024):
                file.write(bytes(2**16))
                file.flush()
    if habit == "talk":
        for number in range(20_000):
            say(f"iteration {number} " + "." * 80)
    if habit == "take memory":
        block = bytearray(b"x") * (200 * 2**20)
        time.sleep(1.5)
        del block


def orphan(arguments: Namespace, name: str, leave_mark: bool = True) -> None:
    """Start a process that ignores signals, in its own session, and note its number.

    Its parent ends at once; a process without the mark ends with the command.
    """
    environment = dict(os.environ) if leave_mark else {}
    noted = arguments.output.parent / f"orphan-{name}"
    wait = (
        "import os, pathlib, signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN);"
        f"pathlib.Path({str(noted)!r}).write_text(str(os.getpid())); time.sleep(600)"
    )
    between = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {wait!r}], start_new_session=True)"
    if leave_mark:
        subprocess.run([sys.executable, "-c", between], env=environment, check=True)
    else:
        subprocess.Popen([sys.executable, "-c", wait], env=environment, start_new_session=True)
    while not noted.exists() or not noted.read_text():
        time.sleep(0.01)


if __name__ == "__main__":
    main()
