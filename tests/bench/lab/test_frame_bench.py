"""``bench frames``: both ways of relighting are timed on the same surfels, and surfels alone are the faster way."""

import json
from pathlib import Path

import pytest
import torch

from radiogs_bench.cli import main
from radiogs_bench.lab.kernels.frames import FRAMES, HEMISPHERE_SAMPLES, LIGHT_SAMPLES, by_rays
from radiogs_core.instruments import recording
from radiogs_core.surfels.known_surfaces import surfels_on
from radiogs_datasets import load_scene


@pytest.mark.slow
def test_the_command_writes_the_numbers_that_it_prints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "frames.json"
    assert main(["bench", "frames", "--spacings", "0.3,0.12", "--json", str(file)]) == 0
    printed = capsys.readouterr().out
    record = json.loads(file.read_text())
    assert [row["spacing"] for row in record["rows"]] == [0.3, 0.12]
    for row in record["rows"]:
        assert f"{row['rays_milliseconds']:.1f}" in printed
        assert row["ratio"] == pytest.approx(row["rays_milliseconds"] / row["surfels_milliseconds"])
        assert row["ratio"] > 1
    assert record["rows"][0]["surfels"] < record["rows"][1]["surfels"]
    assert "torch" in json.dumps(record)


def test_by_rays_shades_every_direction_of_every_surfel_once_a_frame() -> None:
    scene = load_scene("corner-128")
    assert scene.training_light is not None
    surfels = surfels_on(scene.true_surfaces(0.3))
    with recording() as prepared:
        relit = by_rays(surfels, scene.training_light)
    rays = len(surfels) * (HEMISPHERE_SAMPLES + LIGHT_SAMPLES)
    assert prepared.work["rays"] == rays
    with recording() as drawn:
        relit(scene.test[0].camera.to(dtype=torch.float32))
    assert drawn.work["shaded_samples"] == rays
    assert drawn.work["rays"] == 0
    assert len(scene.test) <= FRAMES


@pytest.mark.parametrize(
    ("wrong", "code", "said"),
    [
        (["--spacings", "0"], 2, "'0' is not a number above zero"),
        (["--spacings", "wide"], 2, "'wide' is not a finite number"),
        (["--scene", "hard-cases"], 3, "the surfaces of scene 'hard-cases' are not known"),
    ],
)
def test_spacings_and_scenes_that_cannot_be_measured_are_refused(
    wrong: list[str], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "frames", *wrong]) == code
    assert said in capsys.readouterr().err
