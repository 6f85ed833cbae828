"""The unit of running, storing and resuming, named by the content of everything that decides its result."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

from radiogs.budget import INVERSE_ONLY, RELIGHT_ONLY, Budget
from radiogs.variant import Variant

KEY_LENGTH = 20
"""Hexadecimal digits of a key: 80 bits, so that a million cells collide with probability 4e-13."""


TRAINING = "training"
"""The experiment that trains a model and scores it."""

COST = "cost"
"""The same, and the model is scored along the way too."""

AUDIT = "audit"
"""The first, and what training cost and what its plan predicted stand among the figures."""

TRAINED = (TRAINING, COST, AUDIT)
"""The experiments whose cells go through both stages of training."""


def content_key(content: dict[str, Any]) -> str:
    """SHA-256 prefix of the canonical JSON (sorted keys, no spaces, strict) of plain ``content``."""
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(canonical.encode()).hexdigest()[:KEY_LENGTH]


def plain(variant: Variant) -> dict[str, Any]:
    """A variant's fields as a stored result gives them back, so that the two can be compared: JSON has no tuples."""
    fields: dict[str, Any] = json.loads(json.dumps(asdict(variant)))
    return fields


@dataclass(frozen=True)
class Cell:
    """One training and its evaluation: scene x variant x budget x seed, scored under a protocol.

    ``checksum`` digests the scene's files, ``method_code`` and ``evaluation_code`` the sources (see ``code_version``).
    ``device`` is the kind of machine ("cpu" or "cuda"), because their seconds and last digits differ. The suite is
    not part of a cell: two suites that share a row share its result. ``experiment`` is what is done with all this (see
    ``experiments.registry``), ``settings`` what only that experiment knows.

    Three keys, each of what its product depends on and nothing else, so that cells share what they can:
    ``initialisation_key`` for stage 1, ``training_key`` for the trained model, ``key`` for the scored result.
    """

    scene: str
    checksum: str
    variant: Variant
    budget: Budget
    seed: int
    device: str
    protocol: str
    method_code: str
    evaluation_code: str
    experiment: str = TRAINING
    settings: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def initialisation_key(self) -> str:
        """Names the result of stage 1, which reads only a part of the variant and of the budget."""
        read = self._budget_but(INVERSE_ONLY)
        return content_key(self._common() | self.variant.of_initialisation() | {"budget": read})

    @cached_property
    def training_key(self) -> str:
        """Names the trained model, whatever it is scored by; if scored along the way, the scores are a part of it."""
        read: dict[str, Any] = {"variant": self.variant.of_training(), "budget": self._budget_but(RELIGHT_ONLY)}
        if self.experiment == COST:
            read |= {"experiment": COST, "protocol": self.protocol, "evaluation_code": self.evaluation_code}
        return content_key(self._common() | read)

    @cached_property
    def key(self) -> str:
        """Names the scored result."""
        return content_key(self.content())

    def content(self) -> dict[str, Any]:
        """Everything that the result depends on, as plain values."""
        scored = {"protocol": self.protocol, "evaluation_code": self.evaluation_code}
        done = {"experiment": self.experiment, "settings": dict(self.settings)}
        return self._common() | {"variant": plain(self.variant)} | scored | done

    def _budget_but(self, unread: tuple[str, ...]) -> dict[str, Any]:
        return {name: value for name, value in asdict(self.budget).items() if name not in ("name", *unread)}

    def _common(self) -> dict[str, Any]:
        # The checksum stands for the scene: the same files under another name or path are the same scene.
        return {
            "checksum": self.checksum,
            "budget": asdict(self.budget),
            "seed": self.seed,
            "device": self.device,
            "method_code": self.method_code,
        }
