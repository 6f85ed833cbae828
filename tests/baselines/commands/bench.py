"""A small harness for methods of commands: it steps stages to their end as the real one does, and keeps states."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from radiogs_baselines.commands.method import CommandMethod, CommandVariant, read_method
from radiogs_baselines.commands.trained import TrainedCommand
from radiogs_core.contract import Run
from radiogs_core.scene.scene import Scene

STAND_IN = Path(__file__).with_name("stand_in.py")

CODE = """
[code]
url = "https://example.org/stand-in"
commit = "0123456"
licence = "none"
variable = "STAND_IN_HOME"
python = "STAND_IN_PYTHON"
"""


def toml(train: list[str], render: str = "", relight: str = "", reader: str = "plain", head: str = "") -> str:
    """A method's file around some commands, each the arguments of the stand-in."""
    lines = ['name = "stand-in"', 'title = "Stand-in"', f'reader = "{reader}"', 'layouts = ["tensoir"]', head, CODE]
    for number, arguments in enumerate(train):
        resume = '\nresume = ["--resume"]' if "resumes = true" in head else ""
        lines.append(f"[[train]]\nname = 'stage-{number + 1}'\n{command('train', arguments)}{resume}")
        lines.append(f"writes = ['{{output}}/model-{number + 1}.pth']")
    lines += [f"[render]\n{command('render', render)}"] if render else []
    lines += [f"[relight]\n{command('relight', relight)}"] if relight else []
    return "\n".join(lines)


def command(script: str, arguments: str) -> str:
    """The line with a command's arguments; further lines of its table may follow a line break."""
    arguments, _, further = arguments.partition("\n")
    words = ["{python}", str(STAND_IN), script, "--scene", "{scene}", "--output", "{output}", *arguments.split("|")]
    return f"arguments = {json.dumps([word for word in words if word])}\n{further}"


def method_of(folder: Path, text: str) -> CommandMethod:
    path = folder / "method.toml"
    path.write_text(text)
    return read_method(path)


Cells = Callable[..., "Bench"]
"""Makes a cell from a method's file."""

Shelf = Callable[[str], str]
"""Gives the argument of the stand-in by which it lays out the results of a layout."""


@dataclass
class Bench:
    """Runs one cell; ``states`` holds what the real harness would have stored."""

    method: CommandMethod
    scene: Scene
    workspace: Path
    variant: CommandVariant = field(default_factory=CommandVariant)
    states: list[dict[str, Any]] = field(default_factory=list)

    @property
    def run(self) -> Run:
        budget = self.method.presets["tiny"]
        return Run(self.scene, self.variant, budget, 7, torch.device("cpu"), self.workspace)

    def train(self) -> TrainedCommand:
        """Step all stages to their end; goes on from the states that an earlier call has left."""
        product: dict[str, Any] = {}
        for number, spec in enumerate(self.method.stages(self.variant, self.run.budget)):
            stage = spec.begin(self.run, product)
            if number < len(self.states):
                stage.restore(self.states[number])
            try:
                while stage.iteration < stage.iterations:
                    assert stage.step() == {}
            finally:
                stage.close()  # type: ignore[attr-defined]
                self.states[number:] = [json.loads(json.dumps(stage.state()))]
            product = json.loads(json.dumps(stage.product()))
        return self.method.restore(self.run, product)
