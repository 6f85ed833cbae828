"""Stored files are whole or absent, and as the document describes them."""

import errno
import json
import logging
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from bench.fake_method import CPU, FakeSweep, fake_cell
from radiogs_bench.errors import StoreError
from radiogs_bench.store.atomic import write_atomically
from radiogs_bench.store.claim import Claimed, claim
from radiogs_bench.store.folder import Store
from radiogs_bench.store.keys import content_key
from radiogs_bench.store.provenance import session
from radiogs_bench.store.schema import RESULT_SCHEMA, Failure, MetricValue, Result, Session, StageName
from radiogs_bench.store.seal import sealed, strict_json

ARRAYS = {"image": np.zeros((2, 3, 3), np.float32)}


CELLS: dict[str, dict[str, object]] = {content_key({"name": name}): {"name": name} for name in "ab"}
A, B = CELLS


def result(key: str, value: float = 1.0) -> Result:
    return Result(
        schema=RESULT_SCHEMA, key=key, scene="s", cell=CELLS[key], protocol={"name": "default"}, views=["v"],
        shown_view="v", shown_light=None,
        metrics={"nvs/psnr": {"value": value, "reason": None, "views": [value]}}, timings={}, guards={}, trail={},
        albedo_scale=None,
        facts={"surfels": 1}, maps=[], stages=[], losses={}, seconds={"fit": 0.0, "evaluate": 0.0}, parts={}, work={},
        sessions={}, recovered={}, determined={},
    )  # fmt: skip


def test_a_result_comes_back_as_it_was_put(tmp_path: Path) -> None:
    store = Store(tmp_path / "new" / "folder")
    assert store.result(A) is None
    store.put_result(result(A, 0.1 + 0.2), ARRAYS)
    back = store.result(A)
    assert back is not None
    assert {**back, "arrays": "", "seal": ""} == {**result(A, 0.1 + 0.2), "arrays": "", "seal": ""}
    assert [each["key"] for each in store.results()] == [A]
    with np.load(store.arrays_path(A)) as arrays:
        assert np.array_equal(arrays["image"], ARRAYS["image"])


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[1]", b"\xff\xfe", b'{"schema": "radiogs-bench/result/6", "key": "b"}']
)
def test_a_damaged_result_counts_as_absent_and_is_kept_aside(
    content: bytes, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = Store(tmp_path)
    store.put_result(result(A), ARRAYS)
    (tmp_path / "cells" / f"{A}.json").write_bytes(content)
    with caplog.at_level(logging.WARNING):
        assert store.result(A) is None
    assert "damaged" in caplog.text
    assert (tmp_path / "aside" / f"{A}.json.0").read_bytes() == content
    store.put_result(result(A), ARRAYS)
    (tmp_path / "cells" / f"{A}.json").write_bytes(content)
    assert store.result(A) is None
    assert len(list((tmp_path / "aside").iterdir())) == 2  # the second does not overwrite the first


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"protocol": {}}, "protocol: it lacks 'name'"),
        ({"protocol": {"name": "default", "albedo": "none"}}, "protocol: albedo is 'none'"),
        ({"stages": [{"name": "fit", "title": "Fit"}]}, "losses lacks stage 'fit'"),
        ({"sessions": {"fit": [{**session(CPU), "peak_memory_bytes": {}}]}}, "lacks the peak of memory 'host'"),
        ({"sessions": {"fit": [{**session(CPU), "git": {"dirty": False}}]}}, "sessions.fit[0].git lacks 'commit'"),
    ],
)
def test_a_result_that_lacks_its_own_parts_counts_as_absent(
    changes: dict[str, Any], says: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Its types and its seal are right, as where a hand or another program wrote it."""
    store = Store(tmp_path)
    store.put_result({**result(A), **changes}, ARRAYS)  # type: ignore[typeddict-item]
    with caplog.at_level(logging.WARNING):
        assert store.result(A) is None
    assert says in caplog.text


def test_a_result_of_another_schema_is_not_touched(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.put_result(result(A) | {"schema": "radiogs-bench/result/999"}, ARRAYS)  # type: ignore[arg-type]
    with pytest.raises(StoreError, match="another schema"):
        store.result(A)
    store.put_result(result(B), ARRAYS)
    assert [each["key"] for each in store.results()] == [B]
    assert (tmp_path / "cells" / f"{A}.json").exists()


def test_json_is_strict() -> None:
    with pytest.raises(ValueError, match="Out of range"):
        strict_json({"value": float("nan")})
    assert strict_json({"b": 1, "a": 2}) == strict_json({"a": 2, "b": 1})


def test_tensors_come_back_bit_for_bit(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.tensors("stages/x", CPU) is None
    content = {"state": {"value": torch.randn(5), "generator": torch.Generator().get_state()}, "work": {"rays": 3}}
    store.put_tensors("stages/x", content)
    back = store.tensors("stages/x", CPU)
    assert torch.equal(back["state"]["value"], content["state"]["value"])
    assert back["work"] == {"rays": 3}


@pytest.mark.parametrize("value", range(0, 100, 33))
def test_one_wrong_byte_in_stored_tensors_is_noticed(value: int, tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.put_tensors("stages/x", {"state": torch.arange(100)})
    path = tmp_path / "stages" / "x.pt"
    content = bytearray(path.read_bytes())
    content[content.find(torch.arange(100).numpy().tobytes()) + 8 * value] ^= 0x10
    path.write_bytes(content)
    assert store.tensors("stages/x", CPU) is None
    assert not path.exists()


def test_stored_tensors_that_were_cut_short_are_noticed(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.put_tensors("stages/x", {"state": torch.arange(100)})
    path = tmp_path / "stages" / "x.pt"
    path.write_bytes(path.read_bytes()[:-100])
    assert store.tensors("stages/x", CPU) is None


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_a_full_disk_is_explained_and_the_old_file_stays(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file"
    write_atomically(path, b"old")

    def full(descriptor: int) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StoreError, match="no space left") as caught:
        write_atomically(path, b"new")
    assert "run the same command again" in caught.value.remedy
    assert path.read_bytes() == b"old"
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


def test_a_file_size_limit_of_the_kernel_leaves_the_old_file_whole(tmp_path: Path) -> None:
    """Not simulated: the kernel refuses the write half-way, as it does on a full disk."""
    program = (
        "import resource, signal, sys\n"
        "from pathlib import Path\n"
        "from radiogs_bench.store.atomic import write_atomically\n"
        "from radiogs_bench.errors import StoreError\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "path = Path(sys.argv[1])\n"
        "write_atomically(path, b'old')\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))\n"
        "try:\n"
        "    write_atomically(path, bytes(1_000_000))\n"
        "except StoreError as error:\n"
        "    sys.exit(0 if 'no space left' in error.what else 5)\n"
        "sys.exit(6)\n"
    )
    done = subprocess.run([sys.executable, "-c", program, str(tmp_path / "file")], check=False)
    assert done.returncode == 0
    assert (tmp_path / "file").read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 1


def test_the_arrays_are_complete_before_the_result_exists(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(tmp_path)
    written: list[str] = []
    replace = Path.replace

    def recording(source: Path, target: Path) -> Path:
        written.append(target.name)
        return replace(source, target)

    monkeypatch.setattr(Path, "replace", recording)
    store.put_result(result(A), ARRAYS)
    assert written == [f"{A}.npz", f"{A}.json"]


def test_a_claim_excludes_others_and_ends_with_its_holder(tmp_path: Path) -> None:
    path = tmp_path / "locks" / "cell"
    with claim(path), pytest.raises(Claimed, match=f"process {os.getpid()} on "), claim(path):
        pass
    with claim(path):
        pass
    assert not path.exists()


def test_a_claim_of_a_killed_process_is_free(tmp_path: Path) -> None:
    path = tmp_path / "cell"
    program = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from radiogs_bench.store.claim import claim\n"
        "with claim(Path(sys.argv[1])):\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    subprocess.run([sys.executable, "-c", program, str(path)], check=False)
    assert path.exists()
    with claim(path):
        pass


def test_a_failure_is_remembered_until_the_cell_succeeds(tmp_path: Path) -> None:
    store = Store(tmp_path)
    failure = {
        "schema": RESULT_SCHEMA, "key": A, "scene": "s", "cell": {}, "what": "w", "why": "", "remedy": "",
        "exit_code": 1, "date": "2026-01-01T00:00:00+00:00",
    }  # fmt: skip
    store.put_failure(failure)  # type: ignore[arg-type]
    assert store.failure(A) == sealed(failure)
    assert list(store.results()) == []
    store.put_result(result(A), ARRAYS)
    assert store.failure(A) is None
    assert json.loads((tmp_path / "cells" / f"{A}.json").read_bytes())["key"] == A


DOCUMENT = (Path(__file__).parents[3] / "docs" / "start.md").read_text()


def section(title: str) -> str:
    return DOCUMENT.split(f"{title}", 1)[1].split("\n#", 1)[0]


def test_the_version_is_the_one_that_is_written() -> None:
    assert f"### A cell: `{RESULT_SCHEMA}`" in DOCUMENT
    assert f"| `{RESULT_SCHEMA.removeprefix('radiogs-bench/')}` |" in section("### Versions")


def test_the_document_lists_exactly_the_keys_of_a_result() -> None:
    lines = re.findall(r"^\| `(\w+)` \|", section("### A cell"), re.MULTILINE)
    assert sorted(lines) == sorted(Result.__annotations__)
    lines = re.findall(r"^\| `(\w+)` \|", section("### A session"), re.MULTILINE)
    assert sorted(lines) == sorted(Session.__annotations__)
    for key in (*MetricValue.__annotations__, *StageName.__annotations__):
        assert f"`{key}`" in section("### A cell")
    for key in Failure.__annotations__:
        assert f"`{key}`" in section("### A failure")


def test_a_record_has_the_documented_keys_and_a_peak_for_each_stage(tmp_path: Path) -> None:
    FakeSweep(tmp_path).run([fake_cell()])
    (file,) = (tmp_path / "cells").glob("*.json")
    stored = json.loads(file.read_text())
    assert stored.keys() == Result.__annotations__.keys()
    for name in stored["cell"]:
        assert f"`{name}`" in section("### A cell")
    assert stored["sessions"].keys() == {"initialise", "invert", "evaluate"}
    for stage, sessions in stored["sessions"].items():
        for each in sessions:
            trained = {"yardstick"} if stage != "evaluate" else set()
            assert each.keys() == Session.__required_keys__ | trained
            assert each["peak_memory_bytes"]["host"] > 2**20
            for name in each["machine"]:
                assert f"`{name}`" in section("### A session")
