"""The check of measured values finds values outside marks, and knows where they are allowed."""

from types import ModuleType

import pytest

from ci_scripts import script


@pytest.fixture(scope="module")
def values() -> ModuleType:
    return script("values")


MARKS = (("from records/ablations.md", "record"), ("measured steps", "measured"), ("rehearsal room", "rehearsal"))


@pytest.mark.parametrize(("begin", "end"), MARKS)
def test_values_between_marks_and_in_blocks_of_code_do_not_count(values: ModuleType, begin: str, end: str) -> None:
    text = f"It gains 3.1 dB.\n<!-- {begin} -->\n2 dB, 7 %\n<!-- end of {end} -->\n```sh\nsleep 5 s\n```\nin 12 ms"
    assert values.values_outside(text) == ["3.1 dB", "12 ms"]


@pytest.mark.parametrize("text", ["-0.4 dB", "10 degrees", "45-degree", "1,024 MiB", "95 %", "6°", "2 s"])
def test_every_unit_counts(values: ModuleType, text: str) -> None:
    assert len(values.values_outside(f"about {text}, measured")) == 1


@pytest.mark.parametrize("text", ["600 steps", "96 x 96 pixels", "section 5 says", "v1.2 sets", "N_s 32"])
def test_counts_and_names_are_no_values(values: ModuleType, text: str) -> None:
    assert values.values_outside(text) == []


def test_more_values_than_allowed_fewer_and_entries_without_reason_or_document_are_found(values: ModuleType) -> None:
    documents = {"a.md": "1 dB and 2 dB", "b.md": "nothing"}
    assert values.findings(documents, {"a.md": {"most": 2, "why": "tolerances"}}) == []
    (more,) = values.findings(documents, {"a.md": {"most": 1, "why": "tolerances"}})
    assert "2 values outside marks, 1 in .ci/values.toml; the last: 2 dB" in more
    (fewer,) = values.findings(documents, {"a.md": {"most": 3, "why": "tolerances"}})
    assert "2 values outside marks, 3 in .ci/values.toml" in fewer
    (unexplained,) = values.findings(documents, {"a.md": {"most": 2}})
    assert "gives no reason" in unexplained
    (unknown,) = values.findings({"b.md": ""}, {"c.md": {"most": 0, "why": "tolerances"}})
    assert "it is not there" in unknown
