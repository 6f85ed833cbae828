"""A cell's keys change with everything that its product depends on, and with nothing else."""

import dataclasses
import json
from pathlib import Path

import pytest

from bench.fake_method import fake_cell
from radiogs.budget import budget
from radiogs.profile import PROFILES
from radiogs.variant import Variant
from radiogs_bench.sources import code_digest, evaluation_code, sources_of
from radiogs_bench.suites.cell import TRAINING, Cell, content_key

OTHER: list[Cell] = [
    fake_cell(checksum="1" * 64),
    fake_cell(budget=budget("tiny")),
    fake_cell(seed=1),
    fake_cell(device="cuda"),
    fake_cell(method_code="n"),
]


@pytest.mark.parametrize("cell", OTHER)
def test_every_key_depends_on_scene_budget_seed_device_and_method(cell: Cell) -> None:
    same = fake_cell()
    assert cell.key != same.key
    assert cell.training_key != same.training_key
    assert cell.initialisation_key != same.initialisation_key


@pytest.mark.parametrize("variant", [Variant(radiometric_weight=0.0), Variant(detach="pbr"), Variant(detach="surfel")])
def test_variants_that_stage_1_does_not_read_share_it(variant: Variant) -> None:
    cell = fake_cell(variant=variant)
    assert cell.initialisation_key == fake_cell().initialisation_key
    assert cell.training_key != fake_cell().training_key


@pytest.mark.parametrize("variant", [Variant(initialise="nvs"), Variant(view_share=0.5)])
def test_variants_that_stage_1_reads_do_not_share_it(variant: Variant) -> None:
    assert fake_cell(variant=variant).initialisation_key != fake_cell().initialisation_key


@pytest.mark.parametrize("change", [{"protocol": "irgs"}, {"evaluation_code": "f"}])
def test_another_way_of_scoring_keeps_the_trained_model(change: dict[str, str]) -> None:
    cell = fake_cell(**change)
    assert cell.training_key == fake_cell().training_key
    assert cell.key != fake_cell().key


def test_the_scene_counts_by_its_content_not_by_its_name() -> None:
    assert fake_cell(scene="elsewhere/corner").key == fake_cell().key


def test_every_field_of_the_variant_is_in_the_training_key() -> None:
    for field in dataclasses.fields(Variant):
        assert field.name in fake_cell().content()["variant"]


def test_the_content_is_what_a_stored_result_gives_back() -> None:
    """Else nothing that is looked for by its content is ever found in a store."""
    content = fake_cell(variant=Variant(deviations=PROFILES["released"])).content()
    assert json.loads(json.dumps(content)) == content


def test_keys_are_the_same_in_every_process_and_forever() -> None:
    """A literal: if this fails, every store in the world is out of date, and the schema's version must rise."""
    content = {"b": [1, 2.5, None, True], "a": {"text": "Ä"}}
    # printf '%s' '{"a":{"text":"\\u00c4"},"b":[1,2.5,null,true]}' | sha256sum
    assert content_key(content) == "edea64a45ce29f8f2855"


def test_content_that_is_no_json_has_no_key() -> None:
    with pytest.raises(ValueError, match="Out of range"):
        content_key({"value": float("inf")})


def test_the_code_digest_sees_names_and_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "some_package"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "one.py").write_text("x = 1\n")
    monkeypatch.syspath_prepend(tmp_path)

    def digest() -> str:
        code_digest.cache_clear()
        return code_digest("some_package")

    first = digest()
    assert digest() == first
    (package / "one.py").write_text("x = 2\n")
    second = digest()
    (package / "one.py").rename(package / "two.py")
    assert len({first, second, digest()}) == 3
    code_digest.cache_clear()


def test_the_code_digest_covers_kernels_and_subpackages() -> None:
    assert "radiogs/kernels/counters.py" in sources_of("radiogs")


def test_results_without_lpips_are_scored_again_once_its_weights_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path))
    without = evaluation_code(TRAINING)
    (tmp_path / "alexnet_features.npz").touch()
    (tmp_path / "alex.pth").touch()
    assert evaluation_code(TRAINING) != without
