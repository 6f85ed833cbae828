"""The Python API, by the walk of docs/python_api.md as it stands there."""

import re
from pathlib import Path

import pytest
import torch

import radiogs_bench as rb
from radiogs.showing import TrainedRadioGS
from radiogs_bench import api
from radiogs_bench.cli import main
from radiogs_core.errors import DataError, UsageError

WALK = Path(__file__).parents[2] / "docs" / "python_api.md"


@pytest.mark.slow
def test_the_examples_of_the_python_api_page_run_unchanged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", "ablations", "--preset", "smoke", "--scenes", "corner", "--out", "out/ablations"]) == 0
    blocks = re.findall(r"```python\n(.*?)```", WALK.read_text(), flags=re.DOTALL)
    names: dict[str, object] = {}
    capsys.readouterr()
    for block in blocks:
        exec(compile(block, str(WALK), "exec"), names)
    said = capsys.readouterr().out
    assert "corner 48 training views" in said
    assert "detach-surfel" in said
    assert (tmp_path / "out" / "no-rad" / "surfels.ply").exists()
    again = rb.train("radiogs", "corner", preset="smoke", variant={"radiometric_weight": 0.0}, out="out/no-rad")
    kept = names["kept"]
    assert isinstance(kept, api.Model)
    assert isinstance(kept.trained, TrainedRadioGS)
    assert isinstance(again.trained, TrainedRadioGS)
    others = again.trained.model.surfels.parameters()
    for name, value in kept.trained.model.surfels.parameters().items():
        assert torch.equal(value, others[name])


def test_every_public_name_is_there_and_documented() -> None:
    walk = WALK.read_text()
    assert set(api.__all__) == set(rb.__all__) - {"__version__"}
    for name in api.__all__:
        assert getattr(rb, name) is getattr(api, name)
        assert f"rb.{name}" in walk


def test_errors_of_the_python_api_are_explained(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="unknown method 'radiogz'"):
        rb.train("radiogz", "corner")
    with pytest.raises(UsageError, match="radiometric_wait"):
        rb.train("radiogs", "corner", variant={"radiometric_wait": 0.0})
    with pytest.raises(UsageError, match="unknown preset"):
        rb.train("radiogs", "corner", preset="tinny")
    with pytest.raises(UsageError, match="unknown device 'gpu'"):
        rb.train("radiogs", "corner", device="gpu")
    if not torch.cuda.is_available():
        with pytest.raises(UsageError, match="no CUDA device was found"):
            rb.train("radiogs", "corner", device="cuda")
    with pytest.raises(DataError, match=r"there is no scene '.*nowhere'"):
        rb.train("radiogs", tmp_path / "nowhere")
    with pytest.raises(DataError, match="nothing was trained"):
        rb.open_model(tmp_path)
    with pytest.raises(DataError, match="no run in"):
        rb.open_store(tmp_path)
    with pytest.raises(UsageError, match=r"neither \.hdr nor \.exr"):
        rb.read_light(tmp_path / "light.png")
    with pytest.raises(AttributeError, match="no attribute 'utils'"):
        _ = rb.utils
