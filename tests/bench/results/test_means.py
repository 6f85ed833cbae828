"""Every form of a run's table has the same means and states their units, for kinds with unequal numbers of scenes."""

import csv
import json
import re
import shutil
from pathlib import Path
from typing import cast

import numpy as np
import pytest

import radiogs_bench as rb
from bench.fake_method import FakeSweep, asked, write_sweep
from radiogs_bench.cli import main
from radiogs_bench.results.records import recorded
from radiogs_bench.results.summary import summarise
from radiogs_bench.runs.sweep import CellRef, Sweep, of_scenes, read_sweep
from radiogs_bench.store.folder import Store
from radiogs_bench.store.schema import MetricValue
from radiogs_reports.summary import Summary
from radiogs_reports.tables.paper import paper_table
from radiogs_reports.wording import mean_over
from radiogs_reports.write.paper import paper_csv, paper_latex, paper_markdown

KINDS = {"ball": "round", "bowl": "round", "niche": "front"}
VALUES = dict(zip(KINDS, (30.0, 32.0, 21.0), strict=True))
MEAN = "26.00"
"""Over the two kinds; the mean over the three scenes is 27.67."""

BLACK = np.zeros((8, 8, 3), np.float32)

WORDS = "2 kinds of 3 scenes (ball, bowl, niche), each kind with the mean over its scenes, and 1 seed"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two kinds, one with two scenes; every row has the same values."""
    folder = tmp_path_factory.mktemp("run")
    sweep, request = FakeSweep(folder), asked(3)
    sweep.run([cell for _, cell in request.cells])
    manifest = request.manifest() | {"cells": [_placed(sweep, place) for place, _ in request.cells]}
    manifest |= {"scenes": [*KINDS], "seeds": [0], "kinds": KINDS}
    write_sweep(sweep.store, manifest)
    return folder


def _placed(sweep: FakeSweep, place: CellRef) -> CellRef:
    """A cell of one of three seeds turned into a cell of one of three scenes, with the scene's value."""
    scene, result = [*KINDS][place["seed"]], sweep.store.result(place["key"])
    assert result is not None
    result["scene"] = scene
    result["metrics"]["nvs/psnr"] = MetricValue(value=VALUES[scene], reason=None, views=[VALUES[scene]])
    sweep.store.put_result(result, {"render/image": BLACK, "truth/image": BLACK})
    return {**place, "scene": scene, "seed": 0}


def summary_of(folder: Path) -> Summary:
    return summarise(Store(folder), read_sweep(folder), {}, "four scenes")


def plain(text: str) -> str:
    return " ".join(text.split())


def parts_of(words: str, form: str) -> list[str]:
    """These words as a form has them: a paper's table names the scenes in its note, not in its caption."""
    names = words[words.index("(") + 1 : words.index(")")]
    return [words.replace(f" ({names})", ""), f"Scenes: {names}."] if form == "paper.tex" else [words]


def test_every_form_has_the_same_means_and_states_their_units(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(folder), "--no-pictures"]) == 0
    told = capsys.readouterr()
    assert main(["report", str(folder), "--style", "paper", "--no-pictures"]) == 0
    page = (folder / "report.html").read_text()
    frame = rb.table(folder)
    forms = {
        "terminal": told.out + told.err,
        "page": re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL),
        "Markdown": (folder / "ablations.md").read_text(),
        "LaTeX": (folder / "ablations_table.tex").read_text(),
        "paper.tex": (folder / "paper.tex").read_text(),
        "Python": f"{frame['nvs/psnr'].map('{:.2f}'.format).to_list()} {frame.attrs['caption']}",
    }
    for name, text in forms.items():
        assert MEAN in text, name
        assert "27.67" not in text, name
        assert all(part in plain(text) for part in parts_of(f"Mean over {WORDS}", name)), name
    with (folder / "ablations.csv").open() as file:
        lines = [line for line in csv.DictReader(file) if line["column"] == "nvs/psnr"]
    assert {(float(line["mean"]), line["mean_over"]) for line in lines} == {(26.0, WORDS)}
    stored = json.loads((folder / "summary.json").read_text())["cells"]["ours"]["nvs/psnr"]
    assert stored["mean"] == 26.0


def test_tables_of_the_paper_state_the_units_of_their_means(folder: Path) -> None:
    summary = summary_of(folder)
    (stored,) = summary["paper"]
    assert stored["cells"]["ours"]["nvs/psnr"]["mean"] == 26.0
    table = paper_table(stored, summary)
    for text in (paper_latex(table), paper_markdown(table), paper_csv(stored, summary)):
        assert WORDS in plain(text)


def test_a_record_states_the_units_of_its_means_by_kinds_or_intervals(folder: Path) -> None:
    run = recorded(summary_of(folder))
    assert mean_over(run) == WORDS
    del run["kinds"]
    assert mean_over(run) == WORDS


@pytest.mark.parametrize(
    ("scenes", "kinds", "words"),
    [
        (["ball", "niche"], KINDS, "2 scenes (ball, niche) and 1 seed"),
        (["ball", "bowl"], KINDS, "2 scenes (ball, bowl) and 1 seed"),
        (["ball", "bowl", "niche"], {}, "3 scenes (ball, bowl, niche) and 1 seed"),
        (["ball"], KINDS, "1 scene (ball) and 1 seed"),
    ],
)
def test_words_are_simple_where_each_scene_counts_alike(
    folder: Path, scenes: list[str], kinds: dict[str, str], words: str
) -> None:
    made = summary_of(folder)
    assert mean_over({**made, "scenes": scenes, "kinds": kinds}) == words


STATED = {
    "ball": {"choices": "tuned on"},
    "bowl": {"choices": "reported only", "maker": "other hands"},
    "niche": {"choices": "tuned on", "maker": "other hands", "not_represented": "a clear coat"},
}

MARKED = (
    "2 scenes (ball [tuned on], bowl [other hands]) and 1 seed, without niche [tuned on, other hands, the BRDF cannot"
    " represent a clear coat]"
)


def test_every_form_marks_scenes_and_leaves_out_of_means_what_the_brdf_cannot_represent(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    write_sweep(Store(tmp_path), {**read_sweep(folder), "stated": STATED})
    assert main(["report", str(tmp_path), "--no-pictures"]) == 0
    told = capsys.readouterr().out
    assert main(["report", str(tmp_path), "--style", "paper", "--no-pictures"]) == 0
    names = ("report.html", "ablations.md", "ablations.csv", "ablations_table.tex", "paper.tex")
    for name, text in {"terminal": told, **{name: (tmp_path / name).read_text() for name in names}}.items():
        assert all(part in plain(text) for part in parts_of(MARKED, name)), name
        assert "31.0" in text
        assert MEAN not in text
    made = summary_of(tmp_path)
    assert {cells["nvs/psnr"]["count"] for cells in made["cells"].values()} == {2}
    assert recorded(made)["stated"] == STATED
    (stored,) = made["paper"]
    assert stored["cells"]["ours"]["nvs/psnr"]["mean"] == 31.0


def test_a_run_on_a_scene_that_the_brdf_cannot_represent_has_its_means(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    alone = {**of_scenes(read_sweep(folder), ["niche"]), "stated": STATED}
    made = summarise(Store(tmp_path), cast(Sweep, alone), {}, "one scene")
    assert made["cells"]["ours"]["nvs/psnr"]["mean"] == VALUES["niche"]
