"""Figures: which there are, that their bytes depend on the results alone, and the computations behind them."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from made_up_run import arrays, run, summary, write_run
from radiogs_reports import write_reports
from radiogs_reports.figures import write_figures
from radiogs_reports.figures.canvas import file_name
from radiogs_reports.figures.cost import cost_figure
from radiogs_reports.figures.environment import factors
from radiogs_reports.figures.illumination import direct, illumination_figures
from radiogs_reports.figures.qualitative import crop_place
from radiogs_reports.figures.views import scene_views
from radiogs_reports.maps import display, linear
from radiogs_reports.summary import Summary

OF_A_SCENE = ("image", "albedo", "normal", "indirect", "relit", "illumination", "environment")
CONVERGENCE = ("convergence-losses", "convergence-metrics")
NAMES = ("cost-seconds", "cost-rays", *CONVERGENCE, *(f"my_scene-{name}" for name in OF_A_SCENE))


def two_rows() -> Summary:
    made = summary()
    made["sheet"].append({**made["sheet"][0], "row": "no-rad", "arrays": "cells/def.npz"})
    return made


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all reports; they take seconds to make, and are only looked at."""
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
    (figure,) = [sketch.figure for sketch in cost_figure(made) if sketch.name == "cost-seconds"]
    panels = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_title() for axes in panels] == ["NVS PSNR ↑ (dB)", "Normal MAE ↓ (degrees)"]
    for axes, key, upwards in zip(panels, ("nvs/psnr", "normal/mae"), (True, False), strict=True):
        low, high = axes.get_ylim()
        assert (low < high) == upwards
        values = [each["figures"][key] for each in made["runs"] if each["figures"]]
        assert min(low, high) < min(values)
        assert max(values) < max(low, high)


def test_a_cost_that_is_the_same_for_all_rows_has_no_figure() -> None:
    made = summary()
    for each in made["runs"]:
        each["work"] = {"invert": {"rays": 5}} if each["work"] else {}
    assert [sketch.name for sketch in cost_figure(made)] == ["cost-seconds"]


def test_the_crop_is_the_window_of_the_largest_variance() -> None:
    """Judged by going through every window."""
    generator = np.random.default_rng(3)
    for height, width in ((17, 23), (16, 16), (3, 9)):
        images = [generator.random((height, width, 3)) ** 3 for _ in range(4)]
        down, across = crop_place(images)
        tall, wide = height // 3, width // 3
        variance = np.var(np.stack(images), axis=0).mean(-1)
        tops, lefts = range(height - tall + 1), range(width - wide + 1)
        best = max(
            itertools.product(tops, lefts),
            key=lambda place: variance[place[0] : place[0] + tall, place[1] : place[1] + wide].sum(),
        )
        assert (down.start, across.start) == best
        assert (down.stop - down.start, across.stop - across.start) == (tall, wide)


def test_direct_and_indirect_light_add_up_to_the_image() -> None:
    generator = np.random.default_rng(0)
    parts = generator.random((2, 5, 6, 3)) * 0.4
    found = direct({"image": display(parts.sum(0)), "indirect": parts[1]})
    assert found == pytest.approx(parts[0], abs=1e-6)
    assert linear(np.ones((1, 1, 3))) == pytest.approx(1)
    assert (direct({"image": np.zeros((1, 1, 3)), "indirect": np.ones((1, 1, 3))}) == 0).all()


def test_a_light_is_scaled_by_the_factor_that_fits_best_over_the_sphere() -> None:
    """The factor of each channel, found by lstsq with rows weighted by their solid angle."""
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


def test_rows_that_show_different_views_are_refused(tmp_path: Path) -> None:
    made = two_rows()
    made["sheet"][1]["view"] = "test_005"
    with pytest.raises(ValueError, match="test_004, test_005"):
        scene_views(made, write_run(tmp_path, made))


def test_dollars_in_names_are_dollars(tmp_path: Path) -> None:
    made = two_rows()
    made["rows"][0]["text"], made["columns"][0]["label"] = r"$\undefined$ 5", "$^$"
    for sketch in [*cost_figure(made), *illumination_figures(made, write_run(tmp_path, made))]:
        sketch.figure.draw_without_rendering()  # raises where a name is taken for a formula
    (figure,) = [sketch.figure for sketch in cost_figure(made) if sketch.name == "cost-seconds"]
    assert figure.axes[0].get_title() == r"\$^\$ ↑ (dB)"


def test_names_of_files_suit_every_system_and_latex() -> None:
    assert file_name("my scene/ä_%", "image") == "my_scene-image"
    assert file_name("../", "image") == "_-image"
