"""Commands and suites know effects: what probes find is printed, drawn and kept."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import torch

from radiogs.method import RADIOGS
from radiogs.settings import Variant
from radiogs_bench.cli.main import main
from radiogs_bench.cli.probe import loss_beside
from radiogs_bench.cli.values import effects as effects_option
from radiogs_bench.methods import variant_of
from radiogs_bench.runs.rows import with_effects
from radiogs_bench.runs.trained_folder import read_about, read_trained
from radiogs_bench.suites.registry import read_suite, suite
from radiogs_core.errors import UsageError
from radiogs_core.plain_values import to_plain
from radiogs_core.transport.plan import EFFECTS, EffectPlan
from radiogs_datasets.generate.catalogue import RECIPES
from radiogs_datasets.image_files import write_hdr
from radiogs_datasets.registry import TINY, scene_kind, scene_names


def test_effects_are_given_by_name() -> None:
    assert effects_option("auto") == "auto"
    assert effects_option("specular,visibility") == ("visibility", "specular")
    assert effects_option("none") == ()
    with pytest.raises(UsageError, match="unknown effect 'shadows'"):
        effects_option("shadows")


def test_rows_whose_effects_are_chosen_say_so() -> None:
    marked = with_effects(suite("strategies"), "auto")
    for before, row in zip(suite("strategies").rows, marked.rows, strict=True):
        if row.variant.get("shading") == "split-sum":
            assert row == before
        else:
            assert row.variant["effects"] == "auto"
            assert "auto" in row.text
            assert "auto" in row.latex


def test_the_audit_is_of_all_committed_scenes_of_one_effect() -> None:
    single = {name for name in scene_names() if scene_kind(name) == "single effects"}
    assert set(suite("effects").scenes) == single < set(scene_names(TINY)) < set(RECIPES)


def test_a_suites_file_may_name_effects(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'name = "mine"\ntitle = "Mine"\nreference = "a"\ncolumns = ["nvs/psnr"]\n'
        '[[rows]]\nkey = "a"\ntext = "A"\n'
        '[[rows]]\nkey = "b"\ntext = "B"\nvariant = { effects = ["visibility"] }\n'
        '[[rows]]\nkey = "c"\ntext = "C"\nvariant = { effects = "auto" }\n'
    )
    assert [row.variant.get("effects") for row in read_suite(path).rows] == [None, ["visibility"], "auto"]


def test_a_variant_is_the_same_after_json() -> None:
    for variant in (Variant(), Variant(effects="auto"), Variant(effects=("specular",), deviations=("start-light",))):
        assert variant_of(RADIOGS, json.loads(json.dumps(to_plain(variant)))) == variant


@pytest.mark.slow
def test_a_model_trained_by_evidence_keeps_its_plan_and_can_be_probed_and_relit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "trained"
    assert main(["train", "convex", "--preset", "smoke", "--out", str(out), "--effects", "auto"]) == 0
    assert "all effects are simulated, no probe: without rays" in " ".join(capsys.readouterr().out.split())
    assert read_about(out)["variant"]["effects"] == "auto"
    facts = read_trained(out, torch.device("cpu"))[1].facts()["effects"]
    assert [(record["effect"], record["verdict"]) for record in facts["evidence"]] == [("plan", "on")]
    assert facts["plan"].keys() == EffectPlan().state().keys()

    picture = tmp_path / "where.png"
    assert main(["probe", str(out), "--json", "--picture", str(picture)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {record["effect"] for record in found["evidence"]} >= set(EFFECTS) - {"light-sampling", "samples", "refresh"}
    assert picture.stat().st_size > 0

    even = tmp_path / "even.hdr"
    write_hdr(even, np.full((8, 16, 3), 0.4, np.float32))
    assert main(["relight", str(out), "--envmap", str(even), "--effects", "auto"]) == 0
    said = capsys.readouterr().out
    assert "light-sampling: off" in said
    assert main(["probe", str(out), "--envmap", str(even), "--json", "--picture", str(picture)]) == 0
    found = json.loads(capsys.readouterr().out)
    for record in found["evidence"]:
        assert f"{record['effect']}: {record['verdict']} ({record['why']})" in said


@pytest.mark.slow
def test_a_probe_of_a_scene_gives_its_reasons_and_draws_nothing_unasked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["probe", "convex"]) == 0
    assert not list(tmp_path.iterdir())
    said = capsys.readouterr().out
    assert "visibility" in said
    assert "beside 38 dB" in said
    assert re.search(r"at most 0\.0\d: not needed", said)
    assert "bounces of light that are needed: 1" in said


@pytest.mark.slow
def test_a_probe_of_a_scene_under_another_light_draws_it_relit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_hdr(tmp_path / "even.hdr", np.full((8, 16, 3), 0.4, np.float32))
    picture = tmp_path / "relit.png"
    given = ["probe", "occluder", "--envmap", str(tmp_path / "even.hdr"), "--json", "--picture", str(picture)]
    assert main(given) == 0
    found = json.loads(capsys.readouterr().out)
    assert {record["effect"] for record in found["evidence"]} == {
        "visibility", "indirect", "specular", "light-sampling", "plan",
    }  # fmt: skip
    assert picture.stat().st_size > 0
    (tmp_path / "light.png").touch()
    assert main(["probe", "occluder", "--envmap", str(tmp_path / "light.png")]) == 2


def test_a_loss_beside_a_smaller_error_weighs_more() -> None:
    """A loss that doubles an error of 20 dB costs 3 dB there, and 10 log10(1 + 10) beside a model of 30 dB."""
    doubled = 10 * math.log10(2)
    assert loss_beside(doubled, 1e-2, 20.0) == pytest.approx(doubled)
    assert loss_beside(doubled, 1e-2, 30.0) == pytest.approx(10 * math.log10(11))
    assert loss_beside(0.0, 1e-2, 30.0) == 0
    assert loss_beside(-0.1, 1e-2, 30.0) == 0
    assert loss_beside(math.inf, 1e-2, 30.0) == math.inf


def test_a_scene_without_known_solids_cannot_be_probed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["probe", "furnace-0.5"]) == 3
    assert "radiogs-bench train furnace-0.5" in capsys.readouterr().err
