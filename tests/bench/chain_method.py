"""A stranger's method of any number of stages: nothing in it is RadioGS's, and it does not import it.

Each stage adds its number to what it is handed, a random part with it, so that the end depends on every step.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from radiogs_core.contract import MapKind, Maps, NotOffered, Run, StageSpec, values_but, values_of
from radiogs_core.instruments import count
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap

SOURCES = ("radiogs_core.errors",)


@dataclass(frozen=True)
class Turned:
    """Fields that ablations change; only rendering reads ``shown``."""

    weight: float = 1.0
    shown: float = 1.0


@dataclass(frozen=True)
class Steps:
    """A budget."""

    name: str
    each: int
    sizes: tuple[int, ...] = (8, 4)


class ChainStage:
    """A random walk that counts its steps, and records in the method what is done with it."""

    def __init__(self, chain: "Chain", number: int, run: Run, before: Mapping[str, Any]) -> None:
        self.chain, self.number, self.run = chain, number, run
        self.iteration, self.iterations = 0, run.budget.each
        self.generator = torch.Generator().manual_seed(run.seed + number)
        self.value = before["value"].clone() if before else torch.zeros(1)
        self.open = True

    def step(self) -> Mapping[str, float]:
        name = self.chain.names[self.number]
        self.chain.stepped.append(name)
        if name == self.chain.broken:
            raise ArithmeticError(name)
        self.value = 0.5 * self.value + self.run.variant.weight * torch.randn(1, generator=self.generator)
        self.iteration += 1
        count(steps=1)
        return {"value": float(self.value.abs())}

    def state(self) -> dict[str, Any]:
        return {"iteration": self.iteration, "value": self.value, "generator": self.generator.get_state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        self.iteration, self.value = state["iteration"], state["value"]
        self.generator.set_state(state["generator"])

    def product(self) -> dict[str, Any]:
        assert self.open, "what a stage holds may be where its product lies"
        return {"value": self.value}

    def close(self) -> None:
        self.open = False
        self.chain.closed.append(self.chain.names[self.number])


class ChainPrepared:
    """Shows one grey from everywhere."""

    offers: Mapping[str, MapKind] = {"image": MapKind("display"), "alpha": MapKind("data")}
    default = frozenset(offers)
    timed = False

    def __init__(self, grey: float) -> None:
        self.grey = grey

    def render(self, camera: Camera, *further: str) -> Maps:
        size = camera.height, camera.width
        return {"image": torch.full((*size, 3), self.grey), "alpha": torch.ones(*size, 1)}


class ChainTrained:
    """A grey; it recovers no light and cannot be relit."""

    light = None

    def __init__(self, value: torch.Tensor, shown: float) -> None:
        self.value, self.shown = value, shown

    def facts(self) -> dict[str, Any]:
        return {"value": float(self.value)}

    def export(self, folder: Path) -> list[Path]:
        (folder / "value.txt").write_text(f"{float(self.value)}\n")
        return [folder / "value.txt"]

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: torch.Tensor | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> ChainPrepared:
        if light is not None:
            raise NotOffered("Chain keeps light and surface in one")
        return ChainPrepared(self.shown * float(self.value.sigmoid()))


class Chain:
    """Stages of these names, which remembers what was done with them: ``runs`` and ``begun``, ``stepped``, ``closed``.

    ``compiles`` says it of each stage; ``broken`` is the name of one whose step fails.
    """

    title = "Chain"
    variant = Turned
    presets: Mapping[str, Steps] = {preset.name: preset for preset in (Steps("smoke", 3), Steps("tiny", 5))}
    sources = SOURCES

    def __init__(
        self, names: Sequence[str], compiles: Sequence[bool] = (), name: str = "chain", broken: str = ""
    ) -> None:
        self.names, self.compiles, self.name, self.broken = tuple(names), tuple(compiles), name, broken
        self.runs: list[Run] = []
        self.begun: list[str] = []
        self.stepped: list[str] = []
        self.closed: list[str] = []

    def stages(self, variant: Turned, budget: Steps) -> Sequence[StageSpec]:
        reads = {"variant": values_of(variant, "weight"), "budget": values_but(budget, "name")}
        return [
            StageSpec(
                name=name, title=f"chain, {name}", steps=budget.each, owner=self.name, reads=reads, sources=SOURCES,
                begin=self._beginning(number), compiles=any(self.compiles[number : number + 1]),
            )
            for number, name in enumerate(self.names)
        ]  # fmt: skip

    def restore(self, run: Run, tensors: Mapping[str, Any]) -> ChainTrained:
        return ChainTrained(tensors["value"], run.variant.shown)

    def _beginning(self, number: int) -> Callable[[Run, Mapping[str, Any]], ChainStage]:
        def begin(run: Run, before: Mapping[str, Any]) -> ChainStage:
            assert bool(before) == (number > 0)
            self.runs.append(run)
            self.begun.append(self.names[number])
            return ChainStage(self, number, run, before)

        return begin
