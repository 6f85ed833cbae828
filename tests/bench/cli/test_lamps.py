"""Lamps as options and as files: what is read, and what is refused before a model is opened."""

import json
import tomllib
from pathlib import Path

import pytest
import torch

from bench.chain_method import ChainTrained
from radiogs_bench.cli.lights import lamp
from radiogs_bench.cli.main import main
from radiogs_bench.export.views import lit_by_lamps
from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.lamps import PointLamp, SpotLamp, Sun
from radiogs_datasets.lights import read_lamps

EXAMPLE = Path(__file__).parents[3] / "docs/examples/lamps.toml"


def test_a_file_has_the_lamps_of_the_options_in_toml_and_in_json(tmp_path: Path) -> None:
    found = read_lamps(EXAMPLE)
    spot = SpotLamp(position=(-2.0, 0.0, 3.0), target=(0.0, 0.0, 0.0), inner=10.0, outer=25.0, intensity=60.0)
    assert found[0] == PointLamp(position=(1.5, -1.0, 2.0), intensity=20.0, colour=(1.0, 0.8, 0.6))
    assert lamp("spot", "-2,0,3,0,0,0,10,25,60") == ("spot-2,0,3,0,0,0,10,25,60", spot)
    assert found[1] == spot
    sun = Sun(azimuth=45.0, elevation=30.0, intensity=1.0, colour=(1.5, 2.0, 0.0))
    assert lamp("sun", "45,30,1.5,2,0")[1] == sun
    (tmp_path / "same.JSON").write_text(json.dumps(tomllib.loads(EXAMPLE.read_text())))
    assert read_lamps(str(tmp_path / "same.JSON")) == found


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[[point]]\nposition = [0, 0, 1]\nintensty = 3", r"point\[0\]: there is no field 'intensty'\nDid you mean"),
        ("[[spot]]\nposition = [0, 0, 1]", r"spot\[0\]: it lacks 'target'"),
        ("[[sun]]\nazimuth = 0\nelevation = nan", r"sun\[0\].elevation: nan is not a finite number"),
        ("[[point]]\nposition = [0, 0, 1]\ncolour = [1, -1, 1]", r"point\[0\]: colour: -1.0 is not zero or above"),
        ("", "has no lamp"),
        ("[[point", "is not valid TOML"),
    ],
)
def test_an_invalid_file_of_lamps_is_refused_by_its_field(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "lamps.toml").write_text(content)
    with pytest.raises(DataError, match=message):
        read_lamps(tmp_path / "lamps.toml")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("", "no light is given"),
        ("--point 1,2,3,4,5", "'1,2,3,4,5' is not X,Y,Z[,INTENSITY], with one number or R,G,B for INTENSITY"),
        ("--point 1,2,3,-4", "--point: '1,2,3,-4': intensity: -4.0 is not zero or above"),
        ("--sun 0,91", "a sun has the elevation 91"),
        ("--spot 0,0,3,0,0,0,50,40", "0 <= inner < outer <= 90"),
        ("--spot 0,0,3,0,0,3,10,40", "a spot lamp's target is its position"),
        ("--light ...toml", "...toml has no name to store renders under"),
        ("--light sky.hdr", "sky.hdr is neither .toml nor .json"),
        ("--sun 0,45 --mode path", "--mode does not go with lamps"),
        ("--sun 0,45 --effects none", "--effects does not go with lamps"),
        ("--sun 0,45 " * 40, "the lights have a name of"),
        ("--lamp 0,45", "Unknown option: --lamp"),
    ],
)
def test_impossible_lights_are_refused_before_a_model_is_opened(
    options: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["relight", str(tmp_path / "no-model"), *options.split()]) == 2
    assert message in capsys.readouterr().err


def test_a_method_without_lamps_names_methods_with_lamps() -> None:
    with pytest.raises(UsageError, match=r"gs-ir takes no lamps\nMethods that do: .*radiogs"):
        lit_by_lamps("gs-ir", ChainTrained(torch.zeros(1), 1.0), [Sun(azimuth=0.0, elevation=45.0)])
