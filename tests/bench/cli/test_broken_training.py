"""A NaN in one surfel ends its cell: named, with its iteration, exit code 4, and the state that leads to it kept."""

from pathlib import Path

import pytest
import torch

from radiogs.invert import InverseRendering
from radiogs_bench.cli.main import main
from radiogs_bench.store.folder import Store

BROKEN_AT, SURFEL = 3, 17


@pytest.mark.slow
def test_a_nan_injected_into_one_surfel_is_named_and_its_state_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    step = InverseRendering.step

    def sabotaged(stage: InverseRendering) -> object:
        if stage.iteration == BROKEN_AT and stage.iterations > BROKEN_AT + 1:
            with torch.no_grad():
                stage.optimiser.tensors["roughness_logit"][SURFEL] = torch.nan
        return step(stage)

    monkeypatch.setattr(InverseRendering, "step", sabotaged)
    code = main(["train", "convex", "--preset", "smoke", "--out", str(tmp_path)])
    told = capsys.readouterr().err
    assert code == 4
    assert f"'roughness_logit' is not finite in stage 'invert' at iteration {BROKEN_AT}: surfel {SURFEL}" in told
    (kept,) = tmp_path.rglob("*.broken.pt")
    assert str(kept) in told.replace("\n", " ")
    state = Store(tmp_path).tensors(str(kept.relative_to(tmp_path)).removesuffix(".pt"), torch.device("cpu"))
    assert state is not None
    assert state["state"]["iteration"] == BROKEN_AT
    assert bool(torch.isnan(state["state"]["optimiser"]["tensors"]["roughness_logit"][SURFEL]))
