"""Commands and suites know effects: what probes find is printed, drawn and kept."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import torch

from radiogs.variant import Variant
from radiogs_bench.cli.main import main
from radiogs_bench.cli.options import effects as effects_option
from radiogs_bench.store.folder import Store
from radiogs_bench.suites.registry import suite
from radiogs_bench.suites.suite import with_effects
from radiogs_bench.suites.toml_file import read_suite
from radiogs_bench.training.trained_folder import read_trained, variant_of
from radiogs_core.errors import UsageError
from radiogs_core.transport.plan import EFFECTS, everything
from radiogs_datasets.image_files import write_hdr


def test_effects_are_given_by_name() -> None:
    assert effects_option("auto") == "auto"
    assert effects_option("specular,visibility") == ("visibility", "specular")
    assert effects_option("none") == ()
    with pytest.raises(UsageError, match="unknown effect 'shadows'"):
        effects_option("shadows")


def test_rows_whose_effects_are_chosen_say_so() -> None:
    marked = with_effects(suite("strategies"), "auto")
    for before, row in zip(suite("strategies").rows, marked.rows, strict=True):
        if row.variant.shading == "split-sum":
            assert row == before
        else:
            assert row.variant.effects == "auto"
            assert "auto" in row.text
            assert "auto" in row.latex
    assert with_effects(suite("ablations"), "all") == suite("ablations")


def test_a_suites_file_may_name_effects(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'name = "mine"\ntitle = "Mine"\nreference = "a"\ncolumns = ["nvs/psnr"]\n'
        '[[rows]]\nkey = "a"\ntext = "A"\n'
        '[[rows]]\nkey = "b"\ntext = "B"\nvariant = { effects = ["visibility"] }\n'
        '[[rows]]\nkey = "c"\ntext = "C"\nvariant = { effects = "auto" }\n'
    )
    assert [row.variant.effects for row in read_suite(path).rows] == ["all", ("visibility",), "auto"]


def test_a_variant_survives_being_written_down() -> None:
    for variant in (Variant(), Variant(effects="auto"), Variant(effects=("specular",), deviations=("start-light",))):
        assert variant_of(json.loads(json.dumps(asdict(variant)))) == variant


def test_a_model_trained_by_evidence_keeps_its_plan_and_can_be_probed_and_relit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "trained"
    assert main(["train", "convex", "--preset", "smoke", "--out", str(out), "--effects", "auto"]) == 0
    about, model = read_trained(out, torch.device("cpu"))
    assert about["variant"]["effects"] == "auto"
    assert {record["iteration"] for record in model.evidence} == {0, 10}
    assert model.plan.plain().keys() == everything().plain().keys()
    stored = Store(out).tensors(f"trained/{about['training_key']}", torch.device("cpu"))
    assert stored is not None
    capsys.readouterr()

    picture = tmp_path / "where.png"
    assert main(["probe", str(out), "--json", "--picture", str(picture)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {record["effect"] for record in found["evidence"]} >= set(EFFECTS) - {"light-sampling", "refresh"}
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


def test_a_probe_of_a_scene_says_why(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["probe", "convex", "--picture", str(tmp_path / "convex.png")]) == 0
    said = capsys.readouterr().out
    assert "visibility" in said
    assert "bounces of light that are needed: 1" in said


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


def test_a_scene_without_known_solids_cannot_be_probed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["probe", "furnace-0.5"]) == 3
    assert "radiogs-bench train furnace-0.5" in capsys.readouterr().err
