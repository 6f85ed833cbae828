"""The package as it is installed: its commit, and its extras, libraries that few commands need."""

import json
import subprocess
from functools import cache
from importlib import import_module
from importlib.metadata import distribution
from pathlib import Path
from typing import Any, NotRequired, TypedDict

from radiogs_core.errors import UsageError


class GitState(TypedDict):
    """The state of a repository."""

    commit: str
    dirty: NotRequired[bool]
    """Whether files differ from the commit; absent where pip installed the commit."""


@cache
def git_state(folder: Path = Path(__file__).parent) -> GitState | None:
    """Commit and dirtiness of the repository that tracks this package, else the commit that pip installed it from.

    None where neither knows one, as for a wheel, and where there is no git.
    """

    def git(*arguments: str) -> str | None:
        try:
            done = subprocess.run(["git", *arguments], cwd=folder, capture_output=True, text=True, check=False)
        except FileNotFoundError:
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    tracked = git("ls-files", "--error-unmatch", "__init__.py") is not None
    if tracked and (commit := git("rev-parse", "HEAD")) is not None:
        return {"commit": commit, "dirty": git("status", "--porcelain") != ""}
    installed_from = json.loads(distribution("radiogs-bench").read_text("direct_url.json") or "{}")
    commit = installed_from.get("vcs_info", {}).get("commit_id")
    return None if commit is None else {"commit": commit}


def version_and_commit() -> str:
    """The version, and the commit if it is known: ``0.1.0, commit 0123456789ab, with changes``."""
    number, state = distribution("radiogs-bench").version, git_state()
    known = "unknown" if state is None else f"{state['commit'][:12]}{', with changes' if state.get('dirty') else ''}"
    return f"{number}, commit {known}"


def extra_library(module: str, needed_for: str, extra: str, otherwise: str = "") -> Any:
    """The module. Raises UsageError where it is not installed.

    ``needed_for``: what needs which library ("parquet needs pyarrow"). ``extra``: that of the package that installs it.
    ``otherwise``: what else can be done, after the command.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise UsageError(
            f"{needed_for}, which is not installed",
            str(error).splitlines()[0],
            f"pip install 'radiogs-bench[{extra}]'{otherwise}",
        ) from error
