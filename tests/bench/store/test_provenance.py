"""A result records its origin."""

import datetime
import json
import resource
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from bench.fake_method import CPU
from radiogs_bench import sources
from radiogs_bench.sources import git_state, version_and_commit
from radiogs_bench.store import provenance
from radiogs_bench.store.provenance import peak_memory, peaks_within, reset_peaks, session
from radiogs_core.kernels.runtime import workers


@pytest.fixture(autouse=True)
def _forget_git_state() -> None:
    git_state.cache_clear()


def git(folder: Path, *arguments: str) -> str:
    identity = ["-c", "user.name=n", "-c", "user.email=e@example.org"]
    done = subprocess.run(["git", *identity, *arguments], cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_git_state_describes_the_repository_that_tracks_the_package(tmp_path: Path) -> None:
    git(tmp_path, "init", "--quiet")
    package = tmp_path / "package"
    package.mkdir()
    (package / "__init__.py").write_text("")
    assert git_state(package) is None  # inside a repository that does not track it, as in a virtual environment
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "--quiet", "-m", "m")
    git_state.cache_clear()
    assert git_state(package) == {"commit": git(tmp_path, "rev-parse", "HEAD"), "dirty": False}
    (package / "__init__.py").write_text("x = 1\n")
    git_state.cache_clear()
    assert git_state(package) == {"commit": git(tmp_path, "rev-parse", "HEAD"), "dirty": True}


def test_a_package_that_pip_installed_from_a_repository_knows_its_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = {"url": "https://example.org/it", "vcs_info": {"vcs": "git", "commit_id": "0123456789abcdef"}}
    installed = SimpleNamespace(version="0.1.0", read_text={"direct_url.json": json.dumps(url)}.get)
    monkeypatch.setattr(sources, "distribution", lambda name: installed)
    assert git_state(tmp_path) == {"commit": "0123456789abcdef"}
    monkeypatch.setattr(sources, "git_state", lambda: git_state(tmp_path))
    assert version_and_commit() == "0.1.0, commit 0123456789ab"


def test_the_git_state_is_none_without_git(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert git_state() is None


def test_a_session_names_versions_machine_and_memory() -> None:
    found = session(CPU)
    assert found["versions"]["torch"].startswith(torch.__version__.split("+")[0])
    assert found["machine"]["threads"] == workers(CPU)
    assert found["machine"]["gpu"] is None
    assert datetime.datetime.fromisoformat(found["date"]).utcoffset() == datetime.timedelta(0)


def test_peak_memory_is_in_bytes_and_grows_with_held_memory() -> None:
    before = peak_memory(CPU)["host"]
    assert 2**26 < before < 2**40
    held = torch.ones(before // 4 + 2**24)  # more than the peak so far, in four-byte floats
    assert peak_memory(CPU)["host"] >= 4 * len(held)


def test_memory_held_before_a_stage_does_not_count_for_it() -> None:
    held = torch.ones(2**26)  # 256 MiB
    before = peak_memory(CPU)["host"]
    del held
    reset_peaks(CPU)
    assert peak_memory(CPU)["host"] < before - 2**27


def test_a_part_of_a_stage_has_separate_peaks_and_the_stage_keeps_all() -> None:
    reset_peaks(CPU)
    held = torch.ones(2**26)  # 256 MiB
    del held
    with peaks_within(CPU) as peaks:
        small = torch.ones(2**24)  # 64 MiB
        del small
    assert peaks["host"] < peak_memory(CPU)["host"] - 2**27
    reset_peaks(CPU)
    before = peak_memory(CPU)["host"]
    with peaks_within(CPU) as peaks:
        held = torch.ones(2**26)
        del held
    assert peaks["host"] > before + 2**27
    assert peak_memory(CPU)["host"] >= peaks["host"]


def test_without_a_reset_the_peak_covers_the_whole_process(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(provenance, "PEAK_RESET", tmp_path / "nowhere" / "clear_refs")
    monkeypatch.setattr(provenance, "PROCESS_STATUS", tmp_path / "nowhere")
    reset_peaks(CPU)
    assert peak_memory(CPU)["host"] == resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def test_processors_of_one_name_differ_by_their_instructions(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    digests = []
    for number, (flags, megahertz) in enumerate((("avx2 fma", 3000), ("avx2 fma avx512f", 3000), ("avx2 fma", 2000))):
        information = tmp_path / f"cpuinfo_{number}"
        lines = ("processor\t: {}", "model name\t: Some CPU", f"cpu MHz\t: {megahertz}", f"flags\t\t: {flags}")
        information.write_text("\n\n".join("\n".join(lines).format(core) for core in (0, 1)))
        monkeypatch.setattr(provenance, "CPU_INFORMATION", information)
        provenance.instructions.cache_clear()
        digests.append(provenance.instructions())
    provenance.instructions.cache_clear()
    assert digests[0] == digests[2] != digests[1]
    assert {len(digest) for digest in digests} == {12}


def test_the_cpu_has_a_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    provenance.cpu_name.cache_clear()
    information = tmp_path / "cpuinfo"
    information.write_text("processor\t: 0\nmodel name\t: Some CPU @ 3 GHz\n")
    monkeypatch.setattr(provenance, "CPU_INFORMATION", information)
    assert provenance.cpu_name() == "Some CPU @ 3 GHz"
    provenance.cpu_name.cache_clear()
