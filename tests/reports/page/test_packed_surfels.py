"""Packed surfels of the page: equal to the stored ones, within the documented rounding."""

import base64
from pathlib import Path

import numpy as np
import pytest

from made_up_run import summary, write_run
from radiogs_reports import maps
from radiogs_reports.page.surfels import PACKED, packed, packed_surfels


def stored(seed: int, count: int = 50) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(seed)
    return {
        "surfels/centre": generator.normal(size=(count, 3)),
        "surfels/tangents": 0.1 * generator.normal(size=(count, 2, 3)),
        "surfels/opacity": generator.random(count),
        "surfels/radiance": 1.5 * generator.random((count, 3)),
        "surfels/albedo": generator.random((count, 3)),
        "surfels/roughness": generator.random(count),
        "surfels/count": np.array([3 * count]),
        "surfels/eye": np.array([1.0, 2.0, 3.0]),
        "surfels/up": np.array([0.0, 0.0, 1.0]),
    }


def test_packed_surfels_are_the_stored_ones() -> None:
    arrays = stored(1)
    made = packed(arrays)
    assert PACKED.itemsize == 26, "the script reads 26 bytes a surfel"
    found = np.frombuffer(base64.b64decode(made["surfels"]), PACKED)
    centre = np.array(made["low"]) + np.array(made["step"]) * found["centre"]
    extent = np.ptp(arrays["surfels/centre"], 0)
    assert (np.abs(centre - arrays["surfels/centre"]) <= 0.51 * extent / 65535).all()
    tangents = made["reach"] * found["tangents"] / 32767
    assert tangents == pytest.approx(arrays["surfels/tangents"].reshape(-1, 6), abs=0.51 * made["reach"] / 32767)
    assert found["opacity"] / 255 == pytest.approx(arrays["surfels/opacity"], abs=0.51 / 255)
    assert found["roughness"] / 255 == pytest.approx(arrays["surfels/roughness"], abs=0.51 / 255)
    for name in ("radiance", "albedo"):
        shown = maps.display(arrays[f"surfels/{name}"].clip(0, 1))
        assert found[name] / 255 == pytest.approx(shown, abs=0.51 / 255), name
    assert (made["count"], made["eye"], made["up"]) == (150, [1, 2, 3], [0, 0, 1])


def test_data_for_relighting_are_packed_unchanged_or_left_out_if_too_large(tmp_path: Path) -> None:
    made = summary()
    out = write_run(tmp_path, made)
    lit = {
        "surfels/seen": np.arange(50 * 64).reshape(50, 64) % 256,
        "surfels/met": np.arange(50 * 32).reshape(50, 32) % 51 - 1,
        "surfels/light/dusk": np.random.default_rng(0).random((32, 64, 3)).astype(np.float32),
    }
    with np.load(out / "cells/abc.npz") as there:
        np.savez(out / "cells/abc.npz", allow_pickle=False, **dict(there.items()), **stored(0), **lit)
    whole = packed_surfels(made["runs"], out)["abc"]
    read = {name: base64.b64decode(text) for name, text in whole["relit"].items()}
    assert (np.frombuffer(read["seen"], np.uint8).reshape(50, 64) == lit["surfels/seen"]).all()
    met = np.frombuffer(read["met"], np.uint16).reshape(50, 32).astype(int)
    assert (np.where(met == 65535, -1, met) == lit["surfels/met"]).all()
    assert (np.frombuffer(read["light/dusk"], np.float32) == lit["surfels/light/dusk"].ravel()).all()
    fewer = packed_surfels(made["runs"], out, len(whole["surfels"]) + 100)["abc"]
    assert fewer == whole | {"relit": {}}


def test_surfels_in_one_place_are_packed_without_a_division_by_zero() -> None:
    arrays = stored(2, 1) | {"surfels/tangents": np.zeros((1, 2, 3))}
    made = packed(arrays)
    assert made["low"] == pytest.approx(arrays["surfels/centre"][0].tolist())
    assert np.frombuffer(base64.b64decode(made["surfels"]), PACKED)["tangents"].max() == 0


def test_first_seeds_come_first_within_the_budget_and_cells_without_surfels_are_left_out(tmp_path: Path) -> None:
    made = summary()
    made["runs"][0]["seed"] = 1
    out = write_run(tmp_path, made)
    assert packed_surfels(made["runs"], out) == {}
    for place, key in enumerate(("abc", "def")):
        with np.load(out / f"cells/{key}.npz") as there:
            np.savez(out / f"cells/{key}.npz", allow_pickle=False, **dict(there.items()), **stored(place))
    assert list(packed_surfels(made["runs"], out)) == ["def", "abc"]
    one = len(packed(stored(0))["surfels"])
    assert list(packed_surfels(made["runs"], out, 2 * one - 1)) == ["def"]
