"""The sentences of a run's doubts follow from the stored results, for the rows that they are true of."""

import math
from pathlib import Path
from typing import Any

import pytest

from bench.fake_method import FakeSweep, asked
from radiogs_bench.results.doubts import (
    BRIGHTNESS,
    depends_on,
    doubts,
    elsewhere,
    no_better_than_constant,
    recovered,
    resolution_of_light,
    spread_over_seeds,
    undetermined,
)
from radiogs_bench.results.summary import summarise
from radiogs_bench.scoring.metrics.protocols import PROTOCOLS, protocol
from radiogs_bench.scoring.what_images_determine import STEPS
from radiogs_bench.store.schema import Determined, MetricValue

HIDDEN: dict[str, Any] = {"rise": 1e-7, "offset": None, "half_width": None}
"""Values of a record whose quantity no image shows."""

COLUMNS = ("nvs/psnr", "albedo/psnr", "roughness/mse", "relight/psnr", "environment/error_scaled")


def record(determined: bool, **changes: Any) -> Determined:
    values = {"value": 0.6, "step": 0.1, "views": 8, "error": 1e-4, "rise": 1e-5, "decibels": 0.4, "offset": 0.02,
              "half_width": 0.03, "determined": determined}  # fmt: skip
    return Determined(**(values | changes))  # type: ignore[typeddict-item]


def cell(row: str, seed: int = 0, scene: str = "corner", **content: Any) -> tuple[Any, Any]:
    metrics = {name: MetricValue(value=value, reason=None, views=[])
               for name, value in content.pop("metrics", {}).items()}  # fmt: skip
    base = {"scene": scene, "protocol": protocol("default").describe(), "determined": {}, "albedo_scale": None}
    return {"row": row, "scene": scene, "seed": seed, "key": f"{row}{seed}"}, {**base, **content, "metrics": metrics}


def sweep(*rows: str, columns: tuple[str, ...] = COLUMNS) -> Any:
    return {
        "rows": [{"key": row, "text": row.title()} for row in rows],
        "scenes": ["corner"],
        "seeds": [0],
        "columns": list(columns),
    }


def test_undetermined_roughness_marks_its_rows_with_measurements() -> None:
    cells = [
        cell("ours", determined={"roughness": record(False, **HIDDEN, decibels=0.0123)}),
        cell("glossy", determined={"roughness": record(True)}),
        cell("free", determined={"roughness": record(False, decibels=0.2, rise_free=1e-7, decibels_free=0.0021)}),
    ]
    (found,) = doubts(cells, sweep("ours", "glossy", "free"))
    assert (found["column"], found["rows"]) == ("roughness/mse", ["ours", "free"])
    assert found["text"] == (
        "roughness: changing the roughness of everything by 0.1 changes the error of the training images by 0.002 to"
        " 0.012 dB with everything else held as recovered or free to compensate it; that is less than 8 bits resolve."
        " The images do not determine it."
    )


def test_values_of_an_earlier_version_of_a_protocol_say_so() -> None:
    """Results from before protocols had versions have no title."""
    words = protocol("r3dg").describe()
    before = {name: value for name, value in words.items() if name not in ("title", "version")}
    (found,) = doubts([cell("ours", protocol=before)], sweep("ours", columns=()))
    assert (found["column"], found["rows"]) == ("", [])
    assert found["text"].startswith("Values are by r3dg@1; this program computes r3dg@2")
    assert doubts([cell("ours", protocol=words)], sweep("ours", columns=())) == []
    assert doubts([cell("ours")], sweep("ours", columns=())) == []


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"offset": -0.1, "half_width": 0.3}, "the views do not agree, by up to 4.0 steps"),
        ({"offset": 0.25, "half_width": 0.01}, "the views put it elsewhere, by up to 2.5 steps"),
        ({"offset": 0.02, "half_width": None}, "no value suits all views"),
    ],
)
def test_views_that_disagree_are_not_called_a_lack_of_information(changes: dict[str, Any], says: str) -> None:
    free: dict[str, Any] = {"rise_free": 8e-6, "decibels_free": 0.3}
    for known in ({}, free):
        cells = [cell("ours", determined={"roughness": record(False, **changes, **known)})]
        (found,) = doubts(cells, sweep("ours"))
        assert (found["column"], found["rows"]) == ("roughness/mse", ["ours"])
        assert f"With everything else as it was recovered, {says}; errors of shape" in found["text"]
        assert "do not determine" not in found["text"]
        assert elsewhere(cells, "roughness/mse", ("roughness",)) == [found]
    hidden = [cell("ours", determined={"roughness": record(False, **changes, rise_free=1e-7, decibels_free=0.0)})]
    assert elsewhere(hidden, "roughness/mse", ("roughness",)) == []
    assert len(undetermined(hidden, "roughness/mse", ("roughness",))) == 1


def test_a_difference_that_rounds_to_zero_is_printed_without_a_sign() -> None:
    cells = [cell("ours", determined={"roughness": record(False, **HIDDEN, decibels=-1e-5)})]
    assert "images by 0.000 dB" in undetermined(cells, "roughness/mse", ("roughness",))[0]["text"]


def test_a_row_is_marked_if_one_of_its_cells_is_not_determined() -> None:
    records = [record(True), record(False, **HIDDEN), record(True)]
    cells = [cell("ours", seed, determined={"roughness": each}) for seed, each in enumerate(records)]
    (found,) = undetermined(cells, "roughness/mse", ("roughness",))
    assert found["text"].endswith("8 bits resolve. The images do not determine it in 1 of 3 cells.")


def test_both_quantities_of_roughness_share_a_footnote() -> None:
    both = {"roughness": record(False, **HIDDEN), "roughness variation": record(False, **HIDDEN)}
    (found,) = doubts([cell("ours", determined=both)], sweep("ours"))
    assert "by 0.1 changes" in found["text"]
    assert "roughness variation: giving everything the mean roughness" in found["text"]


def test_brightness_that_no_column_depends_on_is_a_remark_without_a_mark() -> None:
    dark = {"brightness": record(False, **HIDDEN)}
    (found,) = doubts([cell("ours", determined=dark)], sweep("ours"))
    assert found["column"] == ""
    assert found["text"].startswith("brightness: albedo 1.25 times as bright in a light as much darker changes")
    assert "No column depends on it" in found["text"]
    (found,) = doubts([cell("ours", determined=dark)], sweep("ours", columns=("environment/error",)))
    assert found["column"] == "environment/error"
    assert "No column" not in found["text"]


def test_columns_depend_on_brightness_where_their_protocol_does_not_align_them() -> None:
    by_protocol = {
        name: {column for column in ("albedo/psnr", "relight/psnr", "environment/error", "environment/error_scaled")
               if "brightness" in depends_on(column, rules.describe())}
        for name, rules in PROTOCOLS.items()
    }  # fmt: skip
    assert by_protocol["default"] == {"environment/error"}
    assert by_protocol["gs-ir"] == {"environment/error", "relight/psnr"}, "relit without the factor"
    unaligned = {"albedo": {"align": "none", "relights": True}}
    assert depends_on("albedo/ssim", unaligned) == BRIGHTNESS
    assert depends_on("relight/psnr", unaligned) == ()
    assert depends_on("nvs/psnr", unaligned) == depends_on("roughness/constant", unaligned) == ()


@pytest.mark.parametrize(
    ("column", "constant"), [("roughness/mse", "roughness"), ("environment/error_scaled", "light")]
)
def test_a_map_no_better_than_a_constant_is_marked(column: str, constant: str) -> None:
    reference = f"{column.partition('/')[0]}/constant"
    cells = [
        cell("worse", metrics={column: 0.03, reference: 0.02}),
        cell("equal", metrics={column: 0.02, reference: 0.02}),
        cell("better", metrics={column: 0.0199, reference: 0.02}),
        cell("unknown", metrics={column: 0.5}),
    ]
    (found,) = no_better_than_constant(cells, column)
    assert found["rows"] == ["worse", "equal"]
    assert found["text"].startswith(f"no better than a {constant} that is the same everywhere: the best one")
    assert "0.0200" in found["text"]
    assert [each["column"] for each in doubts(cells, sweep("worse", "equal", "better"))] == [column]
    assert no_better_than_constant(cells, "nvs/psnr") == []


def test_no_better_than_a_constant_is_judged_over_all_cells_of_a_row() -> None:
    cells = [cell("ours", seed, metrics={"roughness/mse": value, "roughness/constant": 0.02})
             for seed, value in enumerate((0.05, 0.001))]  # fmt: skip
    (found,) = no_better_than_constant(cells, "roughness/mse")
    assert found["rows"] == ["ours"]
    cells = [*cells, cell("ours", 2, metrics={"roughness/mse": 0.001, "roughness/constant": 0.02})]
    assert no_better_than_constant(cells, "roughness/mse") == []


def test_a_remark_states_the_error_of_resolution_and_rows_near_it() -> None:
    def light(row: str, error: float, floor: float) -> tuple[Any, Any]:
        return cell(row, metrics={"environment/error_scaled": error, "environment/floor": floor})

    cells = [light("near", 0.30, 0.23), light("far", 0.31, 0.23), light("sharp", 0.98, 0.92), cell("unlit")]
    texts = {row["key"]: row["text"] for row in sweep("near", "far", "sharp", "unlit")["rows"]}
    (found,) = resolution_of_light(cells, texts)
    assert (found["column"], found["rows"]) == ("", ["near", "far", "sharp"])
    assert found["text"] == (
        "recovered light: averaged to the resolution of the recovered map, the true light has an error up to scale of"
        " 0.230 to 0.920. Hardly worse than that: Near, Sharp."
    )
    (alone,) = resolution_of_light(cells[1:2], texts)
    assert alone["text"].endswith("an error up to scale of 0.230.")
    assert resolution_of_light(cells[3:], texts) == []
    assert found in doubts(cells, sweep(*texts))
    assert found not in doubts(cells, sweep(*texts, columns=("nvs/psnr",)))


def test_seeds_that_find_different_roughness_are_a_remark() -> None:
    def of(*values: float, scene: str = "corner") -> list[tuple[Any, Any]]:
        return [cell("ours", seed, scene, recovered={"roughness": value}) for seed, value in enumerate(values)]

    # The interval's half-width is 4.303 s / sqrt(3) = 2.484 s for three seeds.
    (found,) = spread_over_seeds(of(0.45, 0.5, 0.55), "roughness/mse", ("roughness",))
    assert found["text"] == "seeds differ: on corner 3 find a mean roughness of 0.50 ± 0.12."
    assert spread_over_seeds(of(0.47, 0.5, 0.53), "roughness/mse", ("roughness",)) == []
    assert spread_over_seeds(of(0.2, 0.8), "roughness/mse", ("roughness",)) == [], "two seeds say nothing"
    apart = [*of(0.3, 0.3, 0.3), *of(0.8, 0.8, 0.8, scene="bowl")]
    assert spread_over_seeds(apart, "roughness/mse", ("roughness",)) == [], "scenes may differ"


def test_seeds_that_find_different_brightness_are_a_remark() -> None:
    cells = [cell("ours", seed, albedo_scale=[scale] * 3) for seed, scale in enumerate((0.8, 1.0, 1.25))]
    (found,) = spread_over_seeds(cells, "environment/error", ("brightness",))
    half_width = 2.4841 * math.log(1.25)
    assert half_width > STEPS["brightness"]
    assert f"a factor of {math.exp(half_width):.2f}" in found["text"]
    assert recovered(cells[2][1], "brightness") == pytest.approx(math.log(1.25))
    assert recovered(cell("ours")[1], "brightness") is None


def test_results_from_before_it_was_measured_leave_no_doubt(tmp_path: Path) -> None:
    place, result = cell("ours")
    del result["determined"]
    assert doubts([(place, result), (place, None)], sweep("ours")) == []
    assert doubts([(place, None)], sweep("ours")) == []


def test_a_summary_carries_the_doubts_of_its_results(tmp_path: Path) -> None:
    request = asked(1)
    places = [place for place, _ in request.cells]
    bench = FakeSweep(tmp_path)
    bench.run([each for _, each in request.cells])
    assert summarise(bench.store, request.manifest(), {}, "none").get("doubts") == []
    result = bench.store.result(places[1]["key"])
    assert result is not None
    result["determined"] = {"roughness": record(False)}
    bench.store.put_result(result, {})
    (found,) = summarise(bench.store, request.manifest(), {}, "none").get("doubts", [])
    assert (found["column"], found["rows"]) == ("roughness/mse", [places[1]["row"]])
