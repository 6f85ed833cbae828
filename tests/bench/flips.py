"""Changes single bytes of a finished run's files and reads them back: each change is seen, or changes nothing.

    python tests/bench/flips.py [COUNT] [SEED]
    python tests/bench/flips.py commands [COUNT] [SEED]

The first prints how many changes of each kind of file were seen, how many left what is read bit for bit as it was (such
as one in white space, or in a field of an archive that no reader looks at), how many changed it with nothing said
("silent"), and how many ended in an error that no reader expects. The second prints how commands end that read damaged
files (see ``commands_on``). Exit code 1 for any silent change, unexpected error, traceback or slow command.
"""

import io
import json
import logging
import random
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Any
from unittest.mock import patch

import torch

from bench.fake_method import CPU, FAKE, FakeSweep, asked, fake_cell, write_sweep
from radiogs_bench.cli import main
from radiogs_bench.errors import StoreError
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.results.baseline import read_baseline
from radiogs_bench.runs.stages import trained
from radiogs_bench.runs.sweep import read_sweep
from radiogs_bench.runs.trained_folder import Origin, read_about, write_trained
from radiogs_bench.store.folder import Store, product_name
from radiogs_bench.store.seal import Broken, seal_of
from radiogs_bench.store.tensor_file import read_tensors
from radiogs_core.errors import DataError
from radiogs_reports.summary import read_summary

Read = Callable[[Path], Any]
SEEN = (Broken, DataError, StoreError)


def finished(folder: Path) -> None:
    """A run with everything that is stored: cells, arrays, products, manifest, summary, baseline, a trained model."""
    sweep, request = FakeSweep(folder), asked(1)
    cells = request.cells
    write_sweep(sweep.store, request.manifest())
    sweep.run([cell for _, cell in cells])
    with patch.dict(substitutes, {FAKE.name: FAKE}):
        for command in (["report"], ["gate", "--baseline", str(folder / "baseline.json"), "--update"]):
            assert main([command[0], str(folder), *command[1:]]) == 0
    key = cells[0][1].key
    result = sweep.store.sealed_result(key)
    words = {"what": "out of memory", "why": "a made-up failure", "remedy": "none", "exit_code": 1, "date": "today"}
    failure = {name: result[name] for name in ("schema", "key", "scene", "cell")}  # type: ignore[literal-required]
    sweep.store.put_failure(failure | words)  # type: ignore[arg-type]
    cell = fake_cell()
    scene = replace(request.scenes["fake"], train=request.scenes["fake"].test)
    write_trained(sweep.store, Origin("fake", "smoke", {}), scene, cell, trained(sweep.bench, cell, scene)[0])


def readers(folder: Path) -> dict[str, tuple[list[Path], Read]]:
    """Files of each kind, and how one of them is read: what comes back is compared."""

    def arrays(path: Path) -> str:
        store = Store(folder)
        store.check_arrays(store.sealed_result(path.stem))
        return "whole"

    def summary(path: Path) -> Any:
        try:
            return read_summary(folder)
        except ValueError as error:  # the reports do not know the harness's errors
            raise Broken(str(error)) from error

    cells, keys = folder / "cells", Store(folder).result_keys()
    return {
        "cell": ([cells / f"{key}.json" for key in keys], lambda p: Store(folder).sealed_result(p.stem)),
        "failure": ([*cells.glob("*.failed.json")], lambda p: Store(folder).sealed_failure(p.name.partition(".")[0])),
        "arrays": ([*cells.glob("*.npz")], arrays),
        "tensors": ([*(folder / "stages").glob("*.pt")], lambda p: read_tensors(p, product_name(p.stem), CPU)),
        "sweep.json": ([folder / "sweep.json"], lambda p: read_sweep(folder)),
        "summary.json": ([folder / "summary.json"], summary),
        "trained.json": ([folder / "trained.json"], lambda p: read_about(folder)),
        "baseline": ([folder / "baseline.json"], read_baseline),
    }


def outcome(path: Path, read: Read, place: int, bits: int) -> str:
    """The outcome of one changed byte; the file is put back."""
    whole, before = path.read_bytes(), read(path)
    content = bytearray(whole)
    content[place] ^= bits
    path.write_bytes(content)
    try:
        return "harmless" if same(read(path), before) else "silent"
    except SEEN:
        return "seen"
    except Exception:  # noqa: BLE001  counted, and shown
        sys.stderr.write(f"{path.name}, byte {place} ^ {bits}\n{traceback.format_exc()}")
        return "unexpected"
    finally:
        path.write_bytes(whole)


def same(one: Any, other: Any) -> bool:
    """Equal in every value and every type."""
    if type(one) is not type(other):
        return False
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, torch.Tensor):
        return one.dtype == other.dtype and torch.equal(one, other)
    return bool(one == other)


def flips(folder: Path, count: int, seed: int) -> dict[str, Counter[str]]:
    """Outcomes of ``count`` changes, spread evenly over the kinds of files, by kind."""
    numbers, kinds = random.Random(seed), readers(folder)
    found: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
    for number in range(count):
        kind = list(kinds)[number % len(kinds)]
        files, read = kinds[kind]
        path = numbers.choice(sorted(files))
        found[kind][outcome(path, read, numbers.randrange(path.stat().st_size), numbers.randrange(1, 256))] += 1
    return found


ODD: tuple[Any, ...] = (None, True, -1, 10**400, 1.5, "x", "\ud800", [], [[]], {}, {"a": None}, ["x", 1])
"""Values that replace values of a stored file."""

COMMANDS = ("status", "report", "verify", "render", "gate", "export", "record")
SEALED = ", sealed again"

SPOKEN = ("damaged", "not used", "gone", "are not")

WRONG = ("silent", "unexpected", "traceback", "slow")

LONGEST = 10.0
"""Seconds that a command may take beyond ten times its time on the undamaged run; beyond them it counts as hanging."""


def damage(content: bytes, numbers: random.Random) -> tuple[str, bytes]:
    """One damage of a stored JSON file: its kind, and the file. Half of the changed values are sealed again."""
    kind = numbers.choice(("type", "type", "type", "key", "key", "seal", "byte", "cut"))
    if kind == "byte":
        place = numbers.randrange(len(content))
        return kind, content[:place] + bytes([numbers.randrange(128, 256)]) + content[place + 1 :]
    if kind == "cut":
        return kind, content[: numbers.randrange(len(content))]
    stored = json.loads(content)
    if kind == "seal":
        stored["seal"] = numbers.choice((*ODD[:5], "0" * 64))
        return kind, json.dumps(stored).encode()
    places = list(_places(stored))
    holder, name = numbers.choice(places)
    if kind == "key":
        del holder[name]
    else:
        holder[name] = numbers.choice(ODD)
    if numbers.random() < 0.7:
        kind += SEALED
        try:
            stored["seal"] = seal_of(stored)
        except ValueError:  # what no text in UTF-8 can hold
            stored["seal"] = ""
    return kind, json.dumps(stored).encode()


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every entry of nested tables and lists, by what holds it and its name or place."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for name, each in list(inner):
        yield value, name
        yield from _places(each)


def commands_on(folder: Path, count: int, seed: int, work: Path) -> Counter[str]:
    """Outcomes of commands on copies of a finished run, in each of which one file is damaged.

    ``explained``: an exit code with its message. ``as before``: 0, with the table of the undamaged run. ``said``: 0,
    and a damage is spoken of. ``read for what it says``: 0, and another table, from a file of right types that was
    sealed again. These must not be: ``silent``, another table without that, ``traceback`` and ``slow``.
    """
    numbers, found = random.Random(seed), Counter[str]()
    whole, usual = {}, {}
    for command in COMMANDS:
        begun = time.monotonic()
        whole[command] = _ended(command, folder)
        usual[command] = time.monotonic() - begun
    names = ["sweep.json", "trained.json", "summary.json", "reports.txt", "baseline.json"]
    names += [f"cells/{path.name}" for path in sorted((folder / "cells").glob("*.json"))]
    for number in range(count):
        copy = work / f"{number}"
        shutil.copytree(folder, copy)
        name = names[number % len(names)] if number % 3 else numbers.choice(names)
        content = (copy / name).read_bytes()
        kind, damaged = damage(content, numbers) if name.endswith(".json") else ("byte", b"\xff" + content[1:])
        (copy / name).write_bytes(damaged)
        for command in COMMANDS:
            begun = time.monotonic()
            code, said = _ended(command, copy)
            if "Traceback" in said:
                outcome = "traceback"
            elif time.monotonic() - begun > LONGEST + 10 * usual[command]:
                outcome = "slow"
            elif code != 0:
                outcome = "explained"
            elif said.replace(str(copy), "") == whole[command][1].replace(str(folder), ""):
                outcome = "as before"
            else:
                quiet = "read for what it says" if kind.endswith(SEALED) else "silent"
                outcome = "said" if any(word in said for word in SPOKEN) else quiet
            if outcome in WRONG:
                sys.stderr.write(f"{name}, {kind}, {command}: {outcome}, {code}\n{said[-1500:]}\n{damaged[:200]!r}\n")
            found[outcome] += 1
        shutil.rmtree(copy)
    return found


def _ended(command: str, folder: Path) -> tuple[int, str]:
    """Exit code of a command on a folder, and all that it prints and logs."""
    said = io.StringIO()
    handler = logging.StreamHandler(said)
    more = {
        "report": ["--no-pictures"], "render": ["--views", "test"],
        "gate": ["--baseline", str(folder / "baseline.json")], "record": ["--to", str(folder / "record.json")],
    }.get(command, [])  # fmt: skip
    with redirect_stdout(said), redirect_stderr(said), patch.dict(substitutes, {FAKE.name: FAKE}):
        logging.getLogger().addHandler(handler)
        try:
            code = main([command, str(folder), *more])
        finally:
            logging.getLogger().removeHandler(handler)
    return code, said.getvalue()


def run() -> int:
    """The command."""
    commands = sys.argv[1:2] == ["commands"]
    count, seed = (int(given or usual) for given, usual in zip_longest(sys.argv[1 + commands :], (2000, 0)))
    with tempfile.TemporaryDirectory() as place, tempfile.TemporaryDirectory() as work:
        finished(Path(place))
        found = {"commands": commands_on(Path(place), count, seed, Path(work))} if commands else None
        found = found or flips(Path(place), count, seed)
    sys.stdout.write(json.dumps(found, indent=1) + "\n")
    return int(any(counts[outcome] for counts in found.values() for outcome in WRONG))


if __name__ == "__main__":
    sys.exit(run())
