"""The scripts in ``.ci`` as modules, for their tests."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

CI = Path(__file__).parents[1] / ".ci"


def script(name: str) -> ModuleType:
    """The script ``.ci/name.py``, loaded anew."""
    spec = importlib.util.spec_from_file_location(name, CI / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up by name
    spec.loader.exec_module(module)
    return module
