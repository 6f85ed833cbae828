"""Methods of strangers: published codes that are run as commands (docs/methods_as_commands.md)."""

from collections.abc import Mapping
from pathlib import Path

from .errors import CommandFailed
from .method import CommandBudget, CommandMethod, CommandStage, CommandVariant, read_method
from .trained import PreparedCommand, TrainedCommand

__all__ = [
    "CommandBudget",
    "CommandFailed",
    "CommandMethod",
    "CommandStage",
    "CommandVariant",
    "PreparedCommand",
    "TrainedCommand",
    "read_method",
    "recipes",
]


def recipes() -> Mapping[str, Path]:
    """Files of the published codes that come with the package, by their methods' names."""
    return {path.stem: path for path in sorted((Path(__file__).parent / "recipes").glob("*.toml"))}
