"""The description of the committed sets of scenes is what their folders hold."""

import json

import pytest

from ci_scripts import script


@pytest.mark.parametrize("name", ["tiny", "forward", "others"])
def test_a_set_has_its_description_and_every_pattern_has_files(name: str) -> None:
    croissant = script("croissant")
    folder = croissant.SETS / name
    text = folder.with_suffix(".croissant.json").read_text(encoding="utf-8")
    assert text == croissant.text_of(folder), "make it anew: python .ci/croissant.py"
    for files in json.loads(text)["distribution"]:
        assert any(folder.parent.glob(files["includes"])), files["name"]
