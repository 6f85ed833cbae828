"""Native text is joined from the sections of its files, and a compiler's message names a file and its line."""

import sys
from pathlib import Path

import pytest
import torch
import warp as wp

from radiogs_core.kernels.native_text import native_file, native_text
from radiogs_core.kernels.runtime import start_warp


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty package ``native_snippets``."""
    folder = tmp_path / "native_snippets"
    folder.mkdir()
    (folder / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "native_snippets", raising=False)
    return folder


def test_a_section_holds_those_that_it_includes_and_says_where_its_lines_come_from(package: Path) -> None:
    (package / "other.inl").write_text("// Other.\n\n// ---- twice\nx += x;\n")
    (package / "own.inl").write_text(
        "// Own.\n\n// ---- start\nSCALAR x = 1;\n\n// ---- all\n"
        '#include "start"\n#include "other.inl:twice"\nout = x;\n'
    )
    other = native_file("native_snippets", "other.inl")
    own = native_file("native_snippets", "own.inl", other=other)
    assert list(own) == ["start", "all"]
    lines = [line for line in own["all"].splitlines() if line]
    assert lines == [
        '#line 7 "own.inl"',
        '#line 4 "own.inl"', "SCALAR x = 1;", '#line 8 "own.inl"',
        '#line 4 "other.inl"', "x += x;", '#line 9 "own.inl"',
        "out = x;",
    ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:compile_aot_module:UserWarning")  # of -march=native
def test_a_message_of_the_compiler_names_the_file_and_its_line(
    package: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (package / "broken.inl").write_text("// Broken.\n\n// ---- all\nSCALAR x = 1;\nout.data[item] = x + nowhere;\n")
    text = native_text(native_file("native_snippets", "broken.inl")["all"], torch.float32, False, {})
    start_warp()

    @wp.func_native(text)
    def write(item: wp.int32, out: wp.array(dtype=wp.float32)): ...

    @wp.kernel(enable_backward=False, module="unique")
    def broken(out: wp.array(dtype=wp.float32)):
        write(wp.tid(), out)

    with pytest.raises(Exception, match="build failed"):
        wp.compile_aot_module(broken.module, device="cpu", module_dir=tmp_path)
    assert "broken.inl:5:" in capfd.readouterr().err


def test_no_section_is_written_twice_in_a_file() -> None:
    folder = Path(sys.modules[native_file.__module__].__file__ or "").parent
    files = sorted(folder.rglob("*.inl"))
    assert files
    for file in files:
        names = [line for line in file.read_text().splitlines() if line.startswith("// ---- ")]
        assert len(names) == len(set(names)), file.name
