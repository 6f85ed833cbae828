"""Proves the project on a CUDA card, part by part, and writes what was found to docs/gpu/<card>.md.

Each part is one command that takes less than nine minutes. A part that has passed is not run again (``--again`` does),
so that a machine which is lent for ten minutes at a time gets through all of them. Nothing is asked of a network.
"""

import argparse
import datetime
import json
import platform
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
NO_CARD = 2
LIMIT = 540.0
"""Seconds of a part."""

TAIL = 40
"""Lines of a part's output that are kept in the report."""


WITHOUT = """error: there is no CUDA device
PyTorch finds none.
Run it on a machine with a card, or try its parts:  .ci/gpu_check.py --device cpu"""


@dataclass(frozen=True)
class Part:
    """A command; its last lines are in the report. ``needs``: a program without which it is left out."""

    name: str
    proves: str
    command: tuple[str, ...]
    needs: str | None = None


def parts(device: str, work: Path) -> list[Part]:
    """The checks of a device, in order: cheap ones that find most come first."""
    bench, on = (sys.executable, "-m", "radiogs_bench"), ("--device", device)
    tests = (sys.executable, "-m", "pytest", "-m", "gpu", "-q", "-n", "0")
    kernels, frames, rehearsal, ablations = (
        str(work / name) for name in ("kernels.json", "frames.json", "rehearsal", "ablations")
    )
    first, second = (str(work / f"trained_{name}") for name in ("once", "again"))
    train = (*bench, "train", "corner", "--preset", "tiny", *on, "--out")
    return [
        Part("kernels agree", "kernels against the dense float64 references, stages and methods on the card", tests),
        Part(
            "sanitizer", "no kernel reads or writes out of bounds",
            ("compute-sanitizer", "--error-exitcode", "9", *tests, "tests/method/core/kernels/test_rasterize.py"),
            needs="compute-sanitizer",
        ),
        Part("kernel speed", "items a second of every kernel", (*bench, "bench", "kernels", *on, "--json", kernels)),
        Part("frame speed", "milliseconds of a relit frame", (*bench, "bench", "frames", *on, "--json", frames)),
        Part("training", "preset tiny from start to metrics", (*train, first)),
        Part("training again", "how far atomics move the metrics of the same training", (*train, second)),
        Part(
            "paper's size", "seconds and memory of every phase at 800 x 800, with a forecast",
            (*bench, "rehearse", "corner", "--as", "100x800x800", "--preset", "paper", *on, "--out", rehearsal),
        ),
        Part(
            "ablations", "the paper's ablation table",
            (*bench, "run", "ablations", "--scenes", "corner", *on, "--out", ablations),
        ),
    ]  # fmt: skip


def run_part(part: Part, record: Path, limit: float = LIMIT) -> dict[str, Any]:
    """Run a part and keep what became of it; one that takes too long is interrupted, and goes on at the next call."""
    started = time.monotonic()
    with subprocess.Popen(
        part.command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    ) as process:
        stopped = False
        try:
            said, _ = process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            stopped = True
            process.terminate()  # runs and trainings keep their state
            said, _ = process.communicate()
    outcome = {
        "part": part.name,
        "command": [Path(part.command[0]).name, *part.command[1:]],
        "state": "stopped" if stopped else "passed" if process.returncode == 0 else "failed",
        "code": process.returncode,
        "seconds": time.monotonic() - started,
        "said": said.splitlines()[-TAIL:],
    }
    record.write_text(json.dumps(outcome, indent=1))
    return outcome


def card() -> dict[str, str] | None:
    """Name, driver and versions; None without a card."""
    import torch

    if not torch.cuda.is_available():
        return None
    asked = ["nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader"]
    driver = subprocess.run(asked, capture_output=True, text=True, check=False).stdout.splitlines()
    memory = torch.cuda.get_device_properties(0).total_memory
    return {
        "card": torch.cuda.get_device_name(0),
        "memory": f"{memory / 2**30:.0f} GiB",
        "driver": driver[0] if driver else "unknown",
        **versions(),
    }


def versions() -> dict[str, str]:
    """Versions of the libraries that compute."""
    import torch
    import warp

    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    return {
        "Python": platform.python_version(),
        "PyTorch": torch.__version__,
        "CUDA of PyTorch": str(torch.version.cuda),
        "Warp": warp.__version__,
        "commit": commit.stdout.strip() or "unknown",
    }


def report(about: dict[str, str], outcomes: Sequence[dict[str, Any]], listed: Sequence[Part]) -> str:
    """The document of a card."""
    proves = {part.name: part.proves for part in listed}
    lines = [f"# {about['card']}", "", f"Measured on {datetime.date.today().isoformat()} by `make gpu`.", ""]
    lines += [f"- {name}: {value}" for name, value in about.items()]
    lines += ["", "| part | what it proves | outcome | s |", "|---|---|---|---:|"]
    for each in outcomes:
        seconds = f"{each['seconds']:.0f}" if "seconds" in each else ""
        lines.append(f"| {each['part']} | {proves[each['part']]} | {each['state']} | {seconds} |")
    for each in outcomes:
        if each.get("said"):
            told = "\n".join(each["said"])
            lines += ["", f"## {each['part']}", "", "```", "$ " + " ".join(each["command"]), told, "```"]
    return "\n".join(lines) + "\n"


def main(
    arguments: Sequence[str] | None = None, listed: Sequence[Part] | None = None, docs: Path = ROOT / "docs/gpu"
) -> int:
    """Run what has not ended yet and write the report; 1 if a part failed or has to go on, 2 without a card."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--device", choices=["cuda", "cpu"], default="cuda", help="cpu: to try the parts without a card"
    )
    parser.add_argument("--only", nargs="+", metavar="PART")
    parser.add_argument("--again", action="store_true", help="also what has ended")
    parser.add_argument("--work", type=Path, default=ROOT / "out/gpu")
    options = parser.parse_args(arguments)
    about = card() if options.device == "cuda" else {"card": "no card: the CPU in its place", **versions()}
    if about is None:
        say(WITHOUT)
        return NO_CARD
    listed = parts(options.device, options.work) if listed is None else listed
    options.work.mkdir(parents=True, exist_ok=True)
    outcomes = []
    for part in listed:
        record = options.work / f"{slug(part.name)}.json"
        known = json.loads(record.read_text()) if record.exists() else None
        wanted = options.only is None or part.name in options.only
        if part.needs is not None and shutil.which(part.needs) is None:
            known = {"part": part.name, "state": f"left out: there is no {part.needs}"}
        elif wanted and (options.again or known is None or known["state"] != "passed"):
            say(f"{part.name} ...")
            known = run_part(part, record)
            say(f"{part.name}: {known['state']} after {known['seconds']:.0f} s")
        outcomes.append(known or {"part": part.name, "state": "not run yet"})
        docs.mkdir(parents=True, exist_ok=True)
        (docs / f"{slug(about['card'])}.md").write_text(report(about, outcomes, listed))
    say(f"wrote {docs / slug(about['card'])}.md")
    return int(any(each["state"] in ("failed", "stopped", "not run yet") for each in outcomes))


def say(line: str) -> None:
    """A line on the terminal, at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def slug(name: str) -> str:
    """A name as a file's."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")


if __name__ == "__main__":
    sys.exit(main())
