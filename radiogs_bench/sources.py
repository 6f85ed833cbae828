"""Digests of the sources: a result is only as good as the code that made it, so the code is part of its name."""

import hashlib
from collections.abc import Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from .metrics.weights import FILES, missing_weights
from .suites.cell import TRAINING

EVALUATION_MODULES = (
    "radiogs_bench.evaluation.evaluate",
    "radiogs_bench.evaluation.figures",
    "radiogs_bench.evaluation.light_maps",
    "radiogs_bench.metrics",
    "radiogs_bench.evaluation.scoring",
)

EXPERIMENT_MODULES: Mapping[str, tuple[str, ...]] = {
    "forward-parity": (
        "radiogs_bench.experiments.forward_parity",
        "radiogs_datasets.furnace",
        "radiogs_datasets.generate.catalogue",
        "radiogs_datasets.generate.surfaces",
    ),
    "stability": ("radiogs_bench.experiments.stability", "radiogs_datasets.hard_cases"),
}
"""What decides an experiment's figures beside the method; others' results need not be made anew when it changes."""


def sources_of(module: str) -> dict[str, Path]:
    """The Python files of a module or package, by their name within it."""
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(f"no module '{module}'")
    if not spec.submodule_search_locations:
        return {module: Path(spec.origin)}
    root = Path(spec.origin).parent
    return {f"{module}/{path.relative_to(root).as_posix()}": path for path in root.rglob("*.py")}


@cache
def code_digest(*modules: str) -> str:
    """SHA-256 over names and bytes of all sources of the modules; independent of where they are installed."""
    digest = hashlib.sha256()
    sources = {name: path for module in modules for name, path in sources_of(module).items()}
    for name in sorted(sources):
        content = sources[name].read_bytes()
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()[:20]


def method_code() -> str:
    """Digest of the method."""
    return code_digest("radiogs")


def evaluation_code(experiment: str = TRAINING) -> str:
    """Digest of what scores a trained model, and which LPIPS it cannot score: once the weights are there, it can."""
    digest = code_digest(*EVALUATION_MODULES, *EXPERIMENT_MODULES.get(experiment, ()))
    missing = [net for net in FILES if missing_weights(net)]
    return f"{digest} without LPIPS weights of {', '.join(missing)}" if missing else digest
