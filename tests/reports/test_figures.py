"""Figures: which there are, that their bytes depend on the results alone, and the computations behind them."""

import itertools
import math
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib import rcParams
from PIL import Image

from made_up_run import LIGHTS, arrays, run, summary, write_run
from radiogs_reports.figures.canvas import ALL, STYLE, file_name, plain, wrapped
from radiogs_reports.figures.convergence import convergence_figures
from radiogs_reports.figures.cost import cost_figures
from radiogs_reports.figures.crops import away_from_edges, crop_place
from radiogs_reports.figures.light import (
    KEY,
    components,
    direct,
    factors,
    illumination_figures,
    indirect_as_incident,
    relighting_figures,
    tone_mapped,
)
from radiogs_reports.figures.overview import FEWEST, LABELS, MOST, OUTLIERS, error_range, lines_of, overview_figures
from radiogs_reports.figures.qualitative import qualitative_figures
from radiogs_reports.figures.views import MOST_ACROSS, scene_views
from radiogs_reports.maps import display, false_colour, linear
from radiogs_reports.run_folder import write_figures, write_reports
from radiogs_reports.summary import Summary
from radiogs_reports.wording import short_number

OF_A_SCENE = (
    "overview", "image", "albedo", "roughness", "normal", "indirect", "relit", "illumination", "environment",
    "relighting",
)  # fmt: skip
CONVERGENCE = ("convergence-losses", "convergence-metrics")
NAMES = ("cost-seconds", "cost-rays", *CONVERGENCE, *(f"my_scene-{name}" for name in OF_A_SCENE))


def two_rows() -> Summary:
    made = summary()
    made["sheet"].append({**made["sheet"][0], "row": "no-rad", "arrays": "cells/def.npz"})
    return made


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all reports; they take seconds to make, and tests only read them."""
    folder = tmp_path_factory.mktemp("run")
    write_reports(write_run(folder, two_rows()))
    return folder


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (folder / "figures").iterdir()}


def test_every_figure_is_there_as_png_and_pdf_and_stands_in_the_document(reports: Path) -> None:
    assert content(reports).keys() == {f"{name}.{kind}" for name in NAMES for kind in ("png", "pdf")}
    included = re.findall(r"\\includegraphics\[.*?\]\{(.*?)\}", (reports / "report.tex").read_text())
    assert set(included) == {f"figures/{name}.pdf" for name in NAMES}


def test_figures_are_rebuilt_byte_for_byte_and_carry_no_date(reports: Path, tmp_path: Path) -> None:
    made = two_rows()
    write_figures(made, write_run(tmp_path, made))
    assert content(tmp_path) == content(reports)
    for name, packed in content(reports).items():
        assert b"CreationDate" not in packed, name
        assert b"atplotlib" not in packed[:2000], name


def test_another_result_is_another_figure(reports: Path, tmp_path: Path) -> None:
    made = two_rows()
    np.savez(write_run(tmp_path, made) / "cells" / "def.npz", allow_pickle=False, **arrays(7))
    write_figures(made, tmp_path)
    before, after = content(reports), content(tmp_path)
    changed = {name for name in before if before[name] != after[name]}
    assert changed == {f"{name}.{kind}" for name in NAMES if name.startswith("my_scene") for kind in ("png", "pdf")}


def test_a_figure_is_large_enough_for_print(reports: Path) -> None:
    for name in NAMES:
        with Image.open(reports / "figures" / f"{name}.png") as image:
            assert image.width > 500
            assert image.height > 250


def test_better_is_higher_up_in_every_panel_and_every_mark_is_inside() -> None:
    made = summary()
    made["runs"].append(run("no-rad", "my_scene", 1, "fed", {"nvs/psnr": 29.0, "normal/mae": 9.0}))
    (figure,) = [sketch.figure for sketch in cost_figures(made) if sketch.name == "cost-seconds"]
    panels = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_title() for axes in panels] == ["NVS PSNR ↑ (dB)", "Normal MAE ↓ (degrees)"]
    for axes, key, upwards in zip(panels, ("nvs/psnr", "normal/mae"), (True, False), strict=True):
        low, high = axes.get_ylim()
        assert (low < high) == upwards
        values = [each["metrics"][key] for each in made["runs"] if each["metrics"]]
        assert min(low, high) < min(values)
        assert max(values) < max(low, high)


@pytest.mark.parametrize("count", [2, 7, 12])
def test_the_legend_of_the_cost_is_within_the_figure(count: int) -> None:
    made = summary()
    first = made["rows"][0]
    made["rows"] += [
        {**first, "key": f"r{place}", "text": f"Method {place} (shared stage 1)"} for place in range(count)
    ]
    made["cells"] |= {f"r{place}": made["cells"][first["key"]] for place in range(count)}
    for sketch in cost_figures(made):
        sketch.figure.canvas.draw()
        (legend,) = sketch.figure.legends
        box, (width, height) = legend.get_window_extent(), sketch.figure.canvas.get_width_height()
        assert box.x0 >= 0
        assert box.x1 <= width
        assert box.y0 >= 0
        assert max(axes.get_window_extent().y0 for axes in sketch.figure.axes) > box.y1
        assert height > box.y1


@pytest.mark.parametrize(("most", "drawn"), [(100, False), (105, False), (106, True)])
def test_a_cost_that_hardly_differs_between_rows_has_no_figure(most: int, drawn: bool) -> None:
    made = summary()
    for each in made["runs"]:
        rays = 100 if each["row"] == "ours" else most
        each["work"] = {"invert": {"rays": rays}} if each["work"] else {}
    assert ("cost-rays" in [sketch.name for sketch in cost_figures(made)]) == drawn


def test_the_crop_is_the_window_of_the_largest_variance_in_what_counts() -> None:
    """Judged by going through every window."""
    generator = np.random.default_rng(3)
    for height, width in ((17, 23), (16, 16), (3, 9)):
        images = [generator.random((height, width, 3)) ** 3 for _ in range(4)]
        for counted in (np.ones((height, width), bool), generator.random((height, width)) > 0.5):
            down, across = crop_place(images, counted)
            tall, wide = height // 3, width // 3
            variance = np.var(np.stack(images), axis=0).mean(-1) * counted
            tops, lefts = range(height - tall + 1), range(width - wide + 1)
            sums = {
                (top, left): variance[top : top + tall, left : left + wide].sum()
                for top, left in itertools.product(tops, lefts)
            }
            assert sums[down.start, across.start] == pytest.approx(max(sums.values()), rel=1e-9)
            assert (down.stop - down.start, across.stop - across.start) == (tall, wide)


def test_a_crop_is_not_drawn_to_a_silhouette_or_a_crease() -> None:
    """Two faces of a box on nothing; the rows differ most by where its edges are, and a little on one face."""
    size = 96
    normal = np.zeros((size, size, 3))
    normal[12:84, 12:48], normal[12:84, 48:84] = (1, 0, 0), (0, 1, 0)
    counted = away_from_edges({"normal": normal}, normal)
    seen = (normal != 0).any(-1)
    assert counted.any()
    assert not counted[~seen].any()
    assert not counted[:, 46:50].any()
    assert not counted[11:15].any()
    assert not counted[:, 81:85].any()
    assert counted[40, 30]
    assert counted[40, 66]
    one, other = np.zeros((size, size, 3)), np.zeros((size, size, 3))
    other[:, 47:49] = other[11:13] = 1.0
    other[50:80, 56:78] += 0.05
    assert all(place.stop <= 56 or place.start < 48 for place in crop_place([one, other], np.ones_like(seen))[1:])
    down, across = crop_place([one, other], counted)
    assert (down.start >= 44, across.start >= 44) == (True, True)


def test_without_normals_every_pixel_counts() -> None:
    assert away_from_edges({}, np.zeros((4, 5, 3))).all()
    assert away_from_edges({"normal": np.zeros((2, 2, 3))}, np.zeros((4, 5, 3))).shape == (4, 5)
    assert crop_place([np.zeros((9, 9, 3)), np.ones((9, 9, 3))], np.zeros((9, 9), bool)) == (slice(0, 3), slice(0, 3))


def test_the_overview_holds_the_maps_their_windows_and_errors_on_one_scale(tmp_path: Path) -> None:
    made = two_rows()
    write_run(tmp_path, made)
    for seed, name in enumerate(("abc", "def")):
        held = arrays(seed)
        near = {f"truth/{kind}": f"render/{kind}" for kind in LABELS}
        held |= {mine: held[true] + 0.1 * (held[mine] - held[true]) for true, mine in near.items()}
        np.savez(tmp_path / "cells" / f"{name}.npz", allow_pickle=False, **held)
    (sketch,) = overview_figures(made, tmp_path)
    (views,) = scene_views(made, tmp_path)
    lines = lines_of(views)
    assert [line.name for line in lines] == list(LABELS)
    tiles = sketch.figure.axes[: 8 * len(lines)]
    end = error_range(lines)
    assert end < 0.2
    assert sketch.figure.axes[-1].get_ylim() == (0, end)
    for start, line in zip(range(0, len(tiles), 8), lines, strict=True):
        shown = [axes.images[0].get_array() for axes in tiles[start : start + 8]]
        for whole, near, picture in zip(shown[:3], shown[3:6], line.pictures, strict=True):
            assert np.array_equal(whole, np.rint(picture * 255))
            assert np.array_equal(near, whole[line.window])
        for place, mine in enumerate(line.pictures[1:]):
            expected = np.abs(mine - line.pictures[0]).mean(-1, keepdims=True)
            assert np.array_equal(shown[6 + place], np.rint(false_colour(expected / end) * 255))
    below = np.mean([error <= end for line in lines for error in line.errors])
    assert below >= 1 - OUTLIERS
    mine = ["Ours", "lambda_rad = 0"]
    assert [axes.get_title().replace("\n", " ") for axes in tiles[:8]] == [
        "truth", *mine, *(f"crop: {each}" for each in ["truth", *mine]), *(f"error: {each}" for each in mine),
    ]  # fmt: skip


def test_there_is_no_overview_of_one_row_or_of_more_than_fit(tmp_path: Path) -> None:
    made = two_rows()
    write_run(tmp_path, made)
    for count in range(1, MOST + 2):
        made["sheet"] = (made["sheet"] * count)[:count]
        assert len(overview_figures(made, tmp_path)) == (FEWEST <= count <= MOST)


def test_direct_and_indirect_light_add_up_to_the_image() -> None:
    generator = np.random.default_rng(0)
    parts = generator.random((2, 5, 6, 3)) * 0.4
    found = direct({"image": display(parts.sum(0)), "indirect": parts[1]})
    assert found == pytest.approx(parts[0], abs=1e-6)
    assert linear(np.ones((1, 1, 3))) == pytest.approx(1)
    assert (direct({"image": np.zeros((1, 1, 3)), "indirect": np.ones((1, 1, 3))}) == 0).all()


def test_true_indirect_light_is_shown_as_incident_where_the_protocol_says_so() -> None:
    """Incident light is not a part of the image, so direct light cannot be computed from it."""
    found = {"image": np.full((2, 2, 3), 0.5), "indirect": np.full((2, 2, 3), 0.01)}
    assert components(found).keys() == {"image", "indirect", "direct"}
    arriving = components(indirect_as_incident(found))
    assert arriving.keys() == {"image", "incident"}
    assert arriving["incident"] == pytest.approx(components(found)["indirect"])


@pytest.mark.parametrize(
    ("compared", "absent"), [({"quantity": "outgoing"}, [3]), ({"quantity": "incident"}, [1, 2]), (None, [3])]
)
def test_missing_ground_truth_leaves_a_labelled_frame(
    tmp_path: Path, compared: dict[str, str] | None, absent: list[int]
) -> None:
    made = two_rows()
    made["conventions"]["indirect"] = compared
    (sketch,) = illumination_figures(made, write_run(tmp_path, made))
    tiles = [axes for axes in sketch.figure.axes if axes.get_visible()]
    assert len(tiles) == 4 * 3
    assert [place // 3 for place, axes in enumerate(tiles) if axes.texts] == absent
    assert [axes.get_ylabel() for axes in tiles[::3]] == [
        "all light", "direct", "indirect light x 4", "incident indirect light x 4",
    ]  # fmt: skip


def test_the_relighting_figure_has_a_line_per_light_and_holds_the_stored_pictures(tmp_path: Path) -> None:
    made = two_rows()
    (sketch,) = relighting_figures(made, write_run(tmp_path, made))
    tiles = sketch.figure.axes
    assert [axes.get_ylabel() for axes in tiles[::3]] == list(LIGHTS)
    assert [axes.get_title() for axes in tiles[:3]] == ["truth", "Ours", "lambda_rad = 0"]
    stored = [arrays(seed) for seed in (0, 1)]
    for line, light in enumerate(LIGHTS):
        sides = [stored[0][f"truth/relit/{light}"], *(each[f"render/relit/{light}"] for each in stored)]
        for axes, image in zip(tiles[3 * line :], sides, strict=False):
            assert np.array_equal(axes.images[0].get_array(), np.rint(image * 255))


def test_indirect_light_under_several_lights_has_a_figure_of_its_own_brighter_than_it_is(tmp_path: Path) -> None:
    made = two_rows()
    folder = write_run(tmp_path, made)
    level = 0.05
    for seed, name in ((0, "abc"), (1, "def")):
        kept = arrays(seed)
        kept |= {f"{side}/relit_indirect/{light}": np.full((16, 16, 3), level, np.float32)
                 for side in ("truth", "render") for light in LIGHTS}  # fmt: skip
        np.savez(folder / "cells" / f"{name}.npz", allow_pickle=False, **kept)
    relit, indirect = relighting_figures(made, folder)
    assert (relit.name, indirect.name) == ("my_scene-relighting", "my_scene-relighting_indirect")
    assert len(indirect.figure.axes) == 3 * len(LIGHTS)
    shown = round(255 * float(display(np.array(4 * level))))
    assert all((axes.images[0].get_array() == shown).all() for axes in indirect.figure.axes)


def test_many_rows_continue_below_and_none_is_lost(tmp_path: Path) -> None:
    made = two_rows()
    (one,) = scene_views(made, write_run(tmp_path, made))
    for count in range(1, 30):
        views = replace(one, rows=[(str(place), {}) for place in range(count)])
        bands = views.bands()
        assert [label for band in bands for label, _ in band.rows] == [str(place) for place in range(count)]
        sizes = [len(band.rows) for band in bands]
        assert max(sizes) == sizes[0] <= MOST_ACROSS
        assert len(bands) == math.ceil(count / MOST_ACROSS)


def test_rows_that_agree_in_a_map_share_one_picture_of_it(tmp_path: Path) -> None:
    made = two_rows()
    folder = write_run(tmp_path, made)
    mine, other = arrays(0), arrays(1)
    np.savez(folder / "cells" / "def.npz", allow_pickle=False, **(other | {"render/image": mine["render/image"]}))
    sketches = {each.name: each.figure.axes for each in qualitative_figures(made, folder)}
    assert [axes.get_title() for axes in sketches["my_scene-image"][:2]] == ["truth", ALL]
    assert [axes.get_title() for axes in sketches["my_scene-albedo"][:3]] == ["truth", "Ours", "lambda_rad = 0"]


def test_a_light_is_scaled_by_the_factor_that_fits_best_over_the_sphere() -> None:
    """Judged by lstsq per channel, with texels weighted by their solid angle."""
    generator = np.random.default_rng(1)
    mine, theirs = generator.random((8, 16, 3)), generator.random((8, 16, 3))
    mine[..., 2] = 0
    found = factors(mine, theirs)
    edges = np.cos(np.linspace(0, np.pi, 9))
    root = np.sqrt(edges[:-1] - edges[1:]).repeat(16)
    for channel in range(2):
        best = np.linalg.lstsq((root * mine[..., channel].ravel())[:, None], root * theirs[..., channel].ravel())[0]
        assert found[channel] == pytest.approx(best[0], rel=1e-9)
    assert found[2] == 0


def test_tone_mapping_separates_sun_sky_and_white_at_any_brightness() -> None:
    """Values against the formula, for a grey sky whose log-mean is its own luminance but for the sun's texel."""
    sky = np.full((16, 32, 3), 0.7)
    sky[4, 16] = 200.0
    for factor in (1e-3, 1.0, 1e4):
        drawn = tone_mapped(factor * sky, factor * sky)
        np.testing.assert_allclose(drawn, tone_mapped(sky, sky), rtol=1e-12)
        assert display(drawn[0, 0]).max() < 0.7 < 0.95 < display(drawn[4, 16]).min() < 1
    brighter = tone_mapped(10 * sky, sky)
    assert display(brighter[0, 0]).max() < 0.95
    assert (brighter > tone_mapped(sky, sky)).all()
    even = tone_mapped(np.full((8, 16, 3), 3.0), np.full((8, 16, 3), 3.0))
    np.testing.assert_allclose(even, KEY / (1 + KEY), rtol=1e-12)


def test_a_black_light_is_drawn_black() -> None:
    assert (tone_mapped(np.zeros((4, 8, 3)), np.zeros((4, 8, 3))) == 0).all()


def test_rows_that_show_different_views_are_refused(tmp_path: Path) -> None:
    made = two_rows()
    made["sheet"][1]["view"] = "test_005"
    with pytest.raises(ValueError, match="test_004, test_005"):
        scene_views(made, write_run(tmp_path, made))


def test_dollars_in_names_are_dollars(tmp_path: Path) -> None:
    made = two_rows()
    made["rows"][0]["text"], made["columns"][0]["label"] = r"$\undefined$ 5", "$^$"
    for sketch in [*cost_figures(made), *illumination_figures(made, write_run(tmp_path, made))]:
        sketch.figure.draw_without_rendering()  # raises where a name is taken for a formula
    (figure,) = [sketch.figure for sketch in cost_figures(made) if sketch.name == "cost-seconds"]
    assert figure.axes[0].get_title() == r"\$^\$ ↑ (dB)"


def test_symbols_are_formulas_that_no_line_breaks() -> None:
    text = "Detach L_G^PBR and λ_rad of $5"
    assert plain(text) == r"Detach $L_\mathrm{G}^\mathrm{PBR}$ and $\lambda_\mathrm{rad}$ of \$5"
    assert wrapped(text).split("\n") == [r"Detach $L_\mathrm{G}^\mathrm{PBR}$ and", r"$\lambda_\mathrm{rad}$ of \$5"]


def test_pictures_in_a_document_have_their_own_pixels(reports: Path) -> None:
    """Magnified ones would take several times the bytes. Crops have a third of 16 pixels, the scale of errors 6."""
    for name in ("image", "relit", "indirect"):
        widths = re.findall(rb"/Width (\d+)", content(reports)[f"my_scene-{name}.pdf"])
        assert {*map(int, widths)} == {5, 6, 16}, name


def test_losses_have_the_sum_of_all_beside_radiometric_consistency() -> None:
    made = two_rows()
    made["runs"][0]["trail"]["invert"][0]["losses"]["consistency"] = 0.0  # it has not set in yet
    losses, _ = convergence_figures(made)
    titles = [axes.get_title() for axes in losses.figure.axes if axes.get_visible()]
    assert titles == [
        "all losses (weighted), stage 1", "all losses (weighted), stage 2", r"$L_\mathrm{rad}$ (weighted), stage 2",
    ]  # fmt: skip
    assert list(losses.figure.axes[1].lines[0].get_ydata()) == [1.0, 0.75, 0.375, 0.1875]
    assert list(losses.figure.axes[2].lines[0].get_xdata()) == [2, 4, 8], "a logarithmic axis shows no zero"
    assert {axes.get_yscale() for axes in losses.figure.axes[:3]} == {"log"}


def test_names_of_files_suit_every_system_and_latex() -> None:
    assert file_name("my_scene", "image") == "my_scene-image"
    awkward = ["s-1", "s_1", "s.1", "s 1", "s__1", "_s_1", "シーン", "場面", "", "..", "../", "x" * 300, "x" * 301]
    names = [file_name(scene, "image") for scene in awkward]
    assert len(set(names)) == len(names), "Audit M5: the report showed one scene under the other's caption"
    assert all(re.fullmatch(r"[A-Za-z0-9_]{1,70}-image", name) for name in names)


def test_numbers_of_ticks_are_short() -> None:
    shown = [short_number(value) for value in (0.2, 5, 1000, 20_000, 5e6)]
    assert shown == ["0.2", "5", "1k", "20k", "5M"]


HOSTILE = "savefig.facecolor: red\nsavefig.dpi: 20\nfont.size: 30\nlines.linewidth: 9\ntext.usetex: True\n"
DRAW = """
import sys
from pathlib import Path
from made_up_run import summary
from radiogs_reports.run_folder import write_figures
write_figures({**summary(), "sheet": []}, Path(sys.argv[1]))
"""


@pytest.mark.parametrize("named_by", ["the folder", "MATPLOTLIBRC", "MPLCONFIGDIR"])
def test_no_matplotlibrc_changes_a_figure(named_by: str, tmp_path: Path) -> None:
    """matplotlib reads the current folder's file first, then these."""
    (tmp_path / "hostile").mkdir()
    (tmp_path / "hostile" / "matplotlibrc").write_text(HOSTILE)
    started_in = tmp_path / "hostile" if named_by == "the folder" else tmp_path
    given = {"PYTHONPATH": str(Path(__file__).parents[1]), named_by: str(tmp_path / "hostile")}
    for folder, name, environment in ((started_in, "drawn", given), (tmp_path, "plain", given | {named_by: ""})):
        command = [sys.executable, "-c", DRAW, str(tmp_path / name)]
        subprocess.run(command, cwd=folder, env=os.environ | environment, check=True)
    assert content(tmp_path / "drawn") == content(tmp_path / "plain")


def test_the_settings_of_figures_are_all_settings_of_matplotlib() -> None:
    assert set(STYLE) >= set(rcParams) - {"backend"}
