"""The page as a file: complete, self-contained, repeatable, and safe against names that are markup."""

import base64
import hashlib
import html
import io
import json
import re
from html.parser import HTMLParser
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from made_up_run import arrays, summary, write_run, written_page
from radiogs_reports.figures.canvas import Drawn
from radiogs_reports.maps import decoded, error, levels
from radiogs_reports.page import assemble, sheets
from radiogs_reports.page.assemble import LARGEST, page
from radiogs_reports.page.assets import json_for_script
from radiogs_reports.page.pictures import Album, album, chosen, reduced_by
from radiogs_reports.run_folder import texts
from radiogs_reports.summary import PLAIN, Summary

VENDORED = {
    "uPlot.iife.min.js": "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
    "uPlot.min.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
}
EVIL = "</script><img src=x onerror=\"document.title='taken'\"><!--'\u2028&amp;"


class Elements(HTMLParser):
    """Every element with its attributes, and the text of scripts and styles by their id or name."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, str] = {}
        self._inside = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        found = dict(attributes)
        self.elements.append((tag, found))
        if tag in ("script", "style"):
            self._inside = found.get("id") or tag
            self.texts[self._inside] = ""

    def handle_endtag(self, tag: str) -> None:
        if tag in ("script", "style"):
            self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.texts[self._inside] += data


def page_of(folder: Path, made: Summary) -> str:
    return written_page(made, folder).read_text(encoding="utf-8")


@pytest.fixture
def text(tmp_path: Path) -> str:
    return page_of(tmp_path, summary())


def test_every_value_is_in_a_table_beside_the_published_one(text: str) -> None:
    plain = html.unescape(re.sub(r"<[^>]+>", " ", text))
    for printed in ("31.23", "-1.23 ± 0.50", "paper 37.86", "n/a", "to do"):
        assert printed in plain
    assert 'title="no_weights"' in text
    assert "n/a: no_weights." in plain
    assert 'data-published="35.82"' in text


def test_a_heading_says_what_its_metric_is_in_both_tables_and_which_values_are_better(tmp_path: Path) -> None:
    made = summary()
    made["columns"][0] |= {"direction": "zero", "meaning": "ratio of <peak> & noise"}
    text = page_of(tmp_path, made)
    assert text.count('class="sort" title="ratio of &lt;peak&gt; &amp; noise"') == 2
    assert 'aria-label="closer to zero is better"' in text


def test_a_resolved_difference_has_a_colour_and_a_rank_in_words(text: str) -> None:
    worse = "1 row resolved to be better than this one, or than one with a better mean"
    assert re.search(rf'<td class="number worse" title="{worse}"[^>]*>30.00<', text)
    assert re.search(r'<td class="number better" title="no row resolved to be better"[^>]*>7.00<', text)
    assert re.search(r'<td class="number" title="no row resolved to be better"[^>]*>31.23<', text)
    assert '<span class="swatch worse">worse</span>' in text


def test_nothing_in_the_page_points_outside_its_folder(text: str) -> None:
    """Links to files beside it, which are offered to be saved; everything else is in the page."""
    for tag, attributes in Elements(text).elements:
        for name in ("src", "href", "action", "srcset", "data", "poster"):
            value = attributes.get(name)
            beside = tag == "a" and "download" in attributes and PLAIN.fullmatch(value or "") is not None
            assert value is None or beside or value.startswith(("#", "data:")), (tag, value)
    assert "@import" not in text
    assert not re.search(r"url\((?!data:|#)", text)


def test_the_policy_lets_only_the_pages_own_script_and_style_pass(text: str) -> None:
    found = Elements(text)
    policy = next(a["content"] for tag, a in found.elements if a.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None
    assert policy.startswith("default-src 'none'")
    for kind in ("script", "style"):
        digest = base64.b64encode(hashlib.sha256(found.texts[kind].encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy
    assert not any(name.startswith("on") or name == "style" for _, a in found.elements for name in a)


def test_names_cannot_become_markup_or_code(tmp_path: Path) -> None:
    made, tame = summary(), summary()
    for each, name in ((made, EVIL), (tame, "tame")):
        each["title"] = each["machine"] = each["protocol"] = each["published_data"] = name
        each["scenes"] = [name]
        each["rows"][0]["text"] = each["columns"][0]["label"] = each["columns"][0]["unit"] = name
        each["cells"]["ours"]["nvs/lpips"]["reason"] = name
        each["conventions"] = {name: name}
        for run in each["runs"]:
            run["scene"] = run["state"] = name
    evil, harmless = Elements(page_of(tmp_path, made)), Elements(page_of(tmp_path, tame))
    assert [tag for tag, _ in evil.elements] == [tag for tag, _ in harmless.elements]
    assert json.loads(evil.texts["data"])["runs"][0]["scene"] == EVIL


def test_json_in_a_script_is_the_same_json_without_a_character_that_could_end_it() -> None:
    content = {EVIL: [EVIL, 1.5, None, {"ä": True}]}
    embedded = json_for_script(content)
    assert json.loads(embedded) == content
    assert not set("<>&\u2028\u2029") & set(embedded)


def test_pictures_are_the_stored_maps_without_loss_and_shared_truths_stand_once(tmp_path: Path) -> None:
    made = album(summary()["runs"], write_run(tmp_path, summary()), LARGEST)
    assert made.factor == 1
    assert not made.files
    assert made.cells.keys() == {"abc", "def"}
    assert made.cells["abc"]["image"]["truth"] == made.cells["def"]["image"]["truth"]
    stored = arrays(0)
    for name in ("image", "roughness"):
        shown = picture(made, "abc", name, "mine", 1)
        assert np.array_equal(shown, levels(stored[f"render/{name}"].astype(np.float64)))
    assert picture(made, "abc", "normal", "error", 1).shape == (16, 16, 3)


def test_pictures_of_further_views_are_their_codes(tmp_path: Path) -> None:
    made, stored = album(summary()["runs"], write_run(tmp_path, summary()), LARGEST), arrays(0)
    assert list(made.cells["abc"]) == [
        "image", "albedo", "normal", "roughness", "depth", "indirect", "incident", "relit/night", "relit/sky",
    ]  # fmt: skip
    assert made.cells["abc"]["depth"]["mine"][0]["views"] == [0, 2]
    assert made.cells["abc"]["relit/night"]["truth"][0]["views"] == [0, 1, 2]
    for name in ("image", "albedo", "normal", "depth", "relit/night"):
        for side, own in (("mine", "render"), ("truth", "truth")):
            codes = stored[f"views/2/{own}/{name}"]
            assert np.array_equal(picture(made, "abc", name, side, 2), codes.repeat(3 // codes.shape[2], -1))
    mine, theirs = (decoded("normal", stored[f"views/0/{side}/normal"]) for side in ("render", "truth"))
    expected = error("normal", mine, theirs)
    assert np.array_equal(picture(made, "abc", "normal", "error", 0), levels(expected.repeat(3, -1)))
    (sheet,) = made.cells["abc"]["normal"]["error"]
    assert (expected <= sheet["tops"][0] + 1e-4).mean() >= 0.99


def test_pictures_are_inside_the_page_and_on_request_files_beside_it(tmp_path: Path) -> None:
    folder = write_run(tmp_path, summary())
    inside, beside = (album(summary()["runs"], folder, budget) for budget in (LARGEST, None))
    assert beside.cells == inside.cells
    assert not beside.inside
    assert {name: base64.b64encode(path.read_bytes()).decode() for name, path in beside.files.items()} == inside.inside
    assert {path.parent for path in beside.files.values()} == {folder / "report_files"}
    policies = [html.unescape(page(summary(), each)) for each in (inside, beside)]
    assert [re.findall(r"img-src ([^;]*);", each)[0] for each in policies] == ["data:", "data: 'self' file:"]


def test_pictures_that_do_not_fit_give_up_exactness_then_views_then_size_then_cells(tmp_path: Path) -> None:
    """Errors and normals are exact in any case; the cell of the later seed goes first."""
    runs, folder = summary()["runs"], write_run(tmp_path, summary(), size=64)
    runs[0]["seed"] = 1
    exact = album(runs, folder, LARGEST)
    lossy = album(runs, folder, size(exact) - 1)
    assert (exact.exact, lossy.exact, lossy.reduced, lossy.factor) == (True, False, False, 1)
    sides = [("image", "error"), *((name, side) for name in ("normal", "image") for side in ("mine", "truth"))]
    kept = [(name, side) for name, side in sides
            if np.array_equal(*(picture(each, "abc", name, side, 2) for each in (exact, lossy)))]  # fmt: skip
    assert kept == sides[:3]
    fewer = album(runs, folder, size(lossy) * 3 // 4)
    assert fewer.reduced
    assert fewer.cells["abc"]["image"]["mine"][0]["views"] == [1, 2], "with the view that the result shows"
    assert fewer.factor == 1
    one = album(runs, folder, size(lossy) * 2 // 5)
    assert one.cells["abc"]["image"]["mine"][0]["views"] == [1]
    smaller = album(runs, folder, size(one) // 2)
    assert smaller.factor == 2
    assert smaller.cells.keys() == one.cells.keys()
    assert picture(smaller, "abc", "image", "mine", 1).shape == (32, 32, 3)
    few = album(runs, folder, size(smaller) * 2 // 3)
    assert few.cells.keys() == {"def"}
    shown = page(summary(), few)
    for said in (
        "1 of 2 finished cells have pictures here",
        "errors and normals without loss",
        "only some of the views",
    ):
        assert said in shown
    assert not album(runs, folder, 1).cells


def test_fewer_views_are_spread_evenly() -> None:
    run = summary()["runs"][0] | {"views": list("abcdefgh"), "view": "d"}
    assert chosen(run, 2) == {3, 7}
    assert chosen(run, 4) == {1, 3, 5, 7}


def test_figures_and_surfels_leave_less_of_a_page_to_pictures_but_a_third(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, folder, drawn, budgets = summary(), write_run(tmp_path, summary()), tmp_path / "drawn.png", list[int]()
    drawn.write_bytes(bytes(30_000))
    monkeypatch.setattr(assemble, "album", lambda runs, out, budget: budgets.append(budget) or Album())
    assemble.write_page(made, folder)
    assemble.write_page(made, folder, [Drawn(drawn, drawn, "a chart", images=False)])
    assert 40_000 < budgets[0] - budgets[1] < 42_000, "three bytes are four characters"
    with monkeypatch.context() as patched:
        patched.setattr(assemble, "packed_surfels", lambda runs, out: {"abc": {"data": "A" * 30_000}})
        assemble.write_page(made, folder)
    assert budgets[0] - budgets[2] > 30_000
    monkeypatch.setattr(assemble, "LARGEST", assemble.LARGEST - budgets[0] + 30)
    assemble.write_page(made, folder)
    assert budgets[3] == assemble.LARGEST // 3


def test_a_sheet_has_one_size_of_picture_and_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sheets, "LARGEST", 40)
    kept: list[np.ndarray] = []

    def keep(sheet: np.ndarray) -> str:
        kept.append(sheet)
        return str(len(kept))

    binder = sheets.Binder(keep)
    for view in range(11):
        binder.add(view, np.full((10 if view < 10 else 20, 20, 1), view / 255))
    bound = binder.bound()
    assert [sheet["views"] for sheet in bound] == [[0, 1, 2, 3, 4, 5, 6, 7], [8, 9], [10]]
    assert [sheet.shape for sheet in kept] == [(40, 40, 3), (10, 40, 3), (20, 20, 3)]
    assert kept[0][30, 39, 0] == 7
    assert [bound[0][part] for part in ("name", "columns", "width", "height")] == ["1", 2, 20, 10]


def test_reduced_maps_are_means_of_blocks() -> None:
    image = np.arange(35, dtype=np.float64).reshape(5, 7, 1) / 35
    small = reduced_by(2, image)
    assert small.shape == (2, 3, 1)
    assert small[1, 2, 0] == pytest.approx(image[2:4, 4:6].mean())
    assert reduced_by(99, image).shape == (1, 1, 1)


def test_a_run_without_results_is_a_page_too(tmp_path: Path) -> None:
    made = summary()
    made["runs"] = [made["runs"][2]]
    made["keys"], made["sheet"], made["conventions"], made["machine"] = [], [], {}, ""
    for row in made["cells"].values():
        for value in row.values():
            value.update(mean=None, difference=None, reason="nothing is finished")
    assert "0 of 1 finished" in page_of(tmp_path, made)


def test_the_plotting_library_is_the_published_one_with_its_licence() -> None:
    folder = resources.files("radiogs_reports.page").joinpath("vendor", "uplot")
    for name, digest in VENDORED.items():
        assert hashlib.sha256(folder.joinpath(name).read_bytes()).hexdigest() == digest
    assert "The MIT License (MIT)" in folder.joinpath("LICENSE").read_text()


def size(made: Album) -> int:
    return sum(map(len, made.inside.values()))


def picture(made: Album, key: str, name: str, side: str, view: int) -> np.ndarray:
    """The picture of a map of a view, from its sheet within the page."""
    (sheet,) = (each for each in made.cells[key][name][side] if view in each["views"])
    with Image.open(io.BytesIO(base64.b64decode(made.inside[sheet["name"]]))) as image:
        whole = np.asarray(image)
    down, across = divmod(sheet["views"].index(view), sheet["columns"])
    height, width = sheet["height"], sheet["width"]
    return whole[height * down : height * (down + 1), width * across : width * (across + 1)]


def test_missing_published_values_are_neither_explained_nor_offered(tmp_path: Path) -> None:
    def of_means(made: Summary) -> str:
        text = page(made, Album())
        return text[text.index('id="table-means"') : text.index('id="cells"')]

    made = summary()
    assert "In italics: the published value" in of_means(made)
    for row in made["published"].values():
        row.clear()
    block = of_means(made)
    assert "In italics: the published value" not in block
    assert '<option value="difference">' in block
    assert '<option value="published">' not in block


def test_symbols_are_set_as_the_paper_sets_them(tmp_path: Path) -> None:
    made = summary()
    made["rows"][0]["text"] = "Detach L_G^PBR & <λ_rad>"
    text = written_page(made, tmp_path).read_text(encoding="utf-8")
    assert "Detach <i>L</i><sub>G</sub><sup>PBR</sup> &amp; &lt;<i>λ</i><sub>rad</sub>&gt;" in text


def test_the_page_shows_the_command_as_it_was_typed(tmp_path: Path) -> None:
    made = summary()
    made["command"] = ["run", "ablations", "--scenes", "my scene", "--long-side", "48"]
    assert "radiogs-bench run ablations --scenes &#39;my scene&#39; --long-side 48" in page_of(tmp_path, made)


def test_the_page_names_the_date_commit_and_command_of_its_run(tmp_path: Path) -> None:
    made = summary()
    for place, run in enumerate(made["runs"]):
        dates = [f"2026-11-{20 + place}T08:00:00+00:00"]
        run["sessions"] = {"invert": [{"date": date, "git": {"commit": "abcdef0123456789", "dirty": place == 0}}
                                      for date in dates]}  # fmt: skip
    text = written_page(made, tmp_path).read_text(encoding="utf-8")
    assert f"2026-11-20 to 2026-11-{19 + len(made['runs'])}" in text
    assert "; commit abcdef0123, abcdef0123 with changes; preset tiny; 1 scene, 2 seeds. Not the paper" in text
    assert f"radiogs-bench run {made['suite']} --scenes" in text
    links = re.findall(r'<a href="([^"#]+)" download>', text)
    assert links == ["ablations.csv", "ablations.md", "ablations.tex", "report.tex", "summary.json"]
    assert {*texts(made), "summary.json"} >= {*links}


def test_figures_of_images_keep_their_colours_on_a_dark_ground(tmp_path: Path) -> None:
    made, drawn = summary(), tmp_path / "drawn.png"
    drawn.write_bytes(b"picture")
    figures = [Drawn(drawn, drawn, caption, images=images) for caption, images in (("a chart", False), ("maps", True))]
    text = page(made, album(made["runs"], write_run(tmp_path, made), None), figures)
    assert re.search(r'<figure class="chart"><img src="data:image/png;base64,cGljdHVyZQ=="[^>]*alt="a chart"', text)
    assert re.search(r'<figure><img [^>]*alt="maps"', text)
