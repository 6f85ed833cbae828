"""Whether a run agrees with the record of its suite, row by row and column by column."""

from pathlib import Path

import pytest

from made_up_run import summary, written_page
from radiogs_bench.results.records import recorded
from radiogs_reports.summary import Summary, Verdict
from radiogs_reports.tables.record import HERE_ALONE, NEITHER, OPEN, OPPOSITE, SAME, claims, record_reports
from radiogs_reports.write.record import record_document


def compared(here: Verdict | None, there: Verdict | None) -> Summary:
    """The made-up run beside a record of it, with these verdicts of row ``no-rad`` in column ``nvs/psnr``."""
    found = []
    for verdict in (there, here):
        made = summary()
        difference = made["cells"]["no-rad"]["nvs/psnr"]["difference"]
        assert difference is not None
        difference["verdict"] = verdict
        found.append(made)
    of_record, made = found
    made["longer_runs"] = [recorded({**of_record, "recipe": "<b>twice</b> the steps"})]
    return made


@pytest.mark.parametrize(
    ("here", "there", "outcome"),
    [
        ("worse", "worse", SAME),
        ("better", "worse", OPPOSITE),
        (None, "worse", OPEN),
        ("worse", None, HERE_ALONE),
        (None, None, NEITHER),
    ],
)
def test_each_difference_has_a_sentence_that_says_whether_the_run_agrees(
    here: Verdict | None, there: Verdict | None, outcome: str
) -> None:
    (report,) = record_reports(compared(here, there))
    quality, shape = report.agreements  # the third column was measured in neither, the reference row has no difference
    marks = [f" ({verdict})" if verdict else "" for verdict in (here, there)]
    assert quality.sentence == (
        f"lambda_rad = 0, NVS PSNR: {outcome}. Here -1.23 ± 0.50 dB{marks[0]}, in the record -1.23 ± 0.50 dB{marks[1]}."
    )
    assert shape.outcome == SAME
    equal, opposite, one = (1 + (outcome == SAME), outcome == OPPOSITE, outcome in (OPEN, HERE_ALONE))
    assert (
        f"{equal} of 2 differences resolved in both with equal signs, {opposite:d} with opposite ones, {one:d} in one."
        in (report.agreement)
    )


def test_the_papers_claims_are_compared_with_every_recipes_values() -> None:
    made = {recipe: recorded({**summary(), "recipe": recipe}) for recipe in ("printed", "recommended")}
    for recipe, (low, high, verdict) in {"printed": (-3.0, -1.0, "worse"), "recommended": (-0.5, 0.1, None)}.items():
        made[recipe]["published"] = {"ours": {"nvs/psnr": 31.0}, "no-rad": {"nvs/psnr": 29.0}}
        kept = made[recipe]["cells"]["no-rad"]["nvs/psnr"]
        assert kept["difference"] is not None
        kept["difference"] |= {"mean": (low + high) / 2, "low": low, "high": high, "verdict": verdict, "smallest": 0.4}
    grid = claims(list(made.values()))
    assert grid is not None
    assert grid.heads == ["suite", "row", "metric", "paper", "printed", "recommended"]
    (line,) = grid.rows
    paper, printed, recommended = line[3:]
    assert paper.value == -2.0
    assert printed.text == "-2.00 dB [-3.00, -1.00]: sign holds"
    assert recommended.text == "-0.20 dB [-0.50, +0.10]: not resolved, could show 0.40; the paper's size excluded"
    (alone,) = [each.rows[0] for each in [claims([made["printed"]])] if each is not None]
    assert len(alone) == 5
    made["printed"]["published"] = {}
    assert claims([made["printed"]]) is None
    assert "## The paper's claims" in record_document([made["recommended"]])


def test_a_value_in_doubt_agrees_with_nothing() -> None:
    """Its verdict is not shown in the table of the run; no sentence may show it."""
    made = compared("worse", "worse")
    made["doubts"] = [{"column": "nvs/psnr", "rows": ["ours"], "text": "not determined"}]
    (report,) = record_reports(made)
    assert report.agreements[0].outcome == OPEN
    kept = recorded(made)["cells"]["no-rad"]["nvs/psnr"]["difference"]
    assert kept is not None
    assert kept["verdict"] is None


def test_the_page_shows_the_record_with_its_origin_and_every_scene(tmp_path: Path) -> None:
    made = compared(None, "worse")
    (report,) = record_reports(made)
    assert list(report.facts)[:3] == ["Date", "Commit", "Command"]
    assert [item.text for item in report.by_scene.rows[0][2:]] == ["-1.00"]
    page = written_page(made, tmp_path).read_text(encoding="utf-8")
    assert report.agreements[0].sentence in page
    assert "&lt;b&gt;twice&lt;/b&gt; the steps" in page
    assert "<b>twice" not in page
    assert "<b>twice" not in record_document(made["longer_runs"])


def test_fields_that_were_set_in_all_rows_stand_with_the_preset_alone() -> None:
    made = summary()
    made["preset"] = "tiny with incident_samples = 64"
    for row in made["rows"]:
        row["text"] += " (incident_samples = 64)"
    made["rows"][1]["text"] += " (of files)"
    kept = recorded(made, "incident_samples = 64")
    assert kept["preset"] == "tiny with incident_samples = 64"
    assert [row["text"] for row in kept["rows"]] == ["Ours", "lambda_rad = 0 (incident_samples = 64) (of files)"]
