"""Native text is joined from the sections of its files, and runs as a kernel whose parameters are listed once."""

import sys
from functools import partial
from pathlib import Path

import pytest
import torch
import warp as wp

from radiogs_core.kernels.native_kernel import flat, native_file, native_kernel
from radiogs_core.kernels.runtime import NATIVE, launch

CPU = torch.device("cpu")


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
    own = native_file("native_snippets", "own.inl", other)
    assert list(own.sections) == ["start", "all"]
    lines = [line for line in own.sections["all"].splitlines() if line]
    assert lines == [
        '#line 7 "own.inl"',
        '#line 4 "own.inl"', "SCALAR x = 1;", '#line 8 "own.inl"',
        '#line 4 "other.inl"', "x += x;", '#line 9 "own.inl"',
        "out = x;",
    ]  # fmt: skip


def test_a_kernel_runs_its_section_for_each_item_with_the_parameters_in_their_order(package: Path) -> None:
    text = "out.data[item] = SCALAR(factor) * given.data[item] + SCALAR(SHIFT) * SCALAR(shift);\n"
    (package / "shifted.inl").write_text(f"// Shifted.\n\n// ---- shifted\n{text}")
    file, dtype = native_file("native_snippets", "shifted.inl"), torch.float64
    parameters = (wp.int32, "factor"), (flat(dtype), "given"), (wp.float64, "shift"), (flat(dtype), "out")
    make = partial(native_kernel, file, dtype, NATIVE, "shifted", "item", *parameters)
    kernel, given, out = make(words={"SHIFT": 0.5}), torch.rand(5, dtype=dtype), torch.zeros(5, dtype=dtype)
    launch(kernel, 5, CPU, [3, given, 7.0, out])
    torch.testing.assert_close(out, 3 * given + 3.5)
    assert kernel.key == "shifted_shifted"
    assert make(words={"SHIFT": 0.5}) is kernel
    assert make(words={"SHIFT": 0.25}).module.name != kernel.module.name


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:compile_aot_module:UserWarning")  # of -march=native
def test_a_message_of_the_compiler_names_the_file_and_its_line(
    package: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (package / "broken.inl").write_text("// Broken.\n\n// ---- all\nSCALAR x = 1;\nout.data[item] = x + nowhere;\n")
    file, dtype = native_file("native_snippets", "broken.inl"), torch.float32
    broken = native_kernel(file, dtype, NATIVE, "all", "item", (flat(dtype), "out"))
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
