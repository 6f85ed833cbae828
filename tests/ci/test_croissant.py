"""The description of the committed sets of scenes is what their folders hold."""

import importlib.util
import json
from pathlib import Path

import pytest

CI = Path(__file__).parents[2] / ".ci" / "croissant.py"
spec = importlib.util.spec_from_file_location("croissant", CI)
assert spec is not None
assert spec.loader is not None
croissant = importlib.util.module_from_spec(spec)
spec.loader.exec_module(croissant)


@pytest.mark.parametrize("folder", croissant.sets(), ids=lambda folder: folder.name)
def test_a_set_has_its_description_and_every_pattern_has_files(folder: Path) -> None:
    text = (folder / "croissant.json").read_text(encoding="utf-8")
    assert text == croissant.text_of(folder), "make it anew: python .ci/croissant.py"
    for files in json.loads(text)["distribution"]:
        assert any(folder.rglob(files["includes"])), files["name"]
