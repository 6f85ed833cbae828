"""Whether Mitsuba can render here, tested in a separate process, because some LLVM versions abort it."""

import subprocess
import sys
from collections.abc import Mapping, Sequence

from radiogs_core.errors import UsageError

VARIANT = "llvm_ad_rgb"

SCRIPT = f"""
import mitsuba as mi
mi.set_variant("{VARIANT}")
mi.render(mi.load_dict({{"type": "scene", "integrator": {{"type": "path"}}, "shape": {{"type": "sphere"}},
    "light": {{"type": "constant"}}, "sensor": {{"type": "perspective", "film": {{"type": "hdrfilm", "width": 4,
    "height": 4}}}}}}), spp=1).numpy()
"""


def require_mitsuba() -> None:
    """Raise UsageError, saying what to install, unless a 4 x 4 image can be rendered."""
    reason = mitsuba_failure()
    if reason is not None:
        raise UsageError(
            "Mitsuba 3 cannot render on this machine",
            f"A trial render failed: {reason}",
            "Install it with  pip install 'radiogs-bench[generate]'  and an LLVM it works with (Debian, Ubuntu:"
            "  apt-get install libllvm19);  LLVM 14 to 16 are known to fail. The committed scenes need neither.",
        )


def mitsuba_failure() -> str | None:
    """The last words of a trial render that failed; None if it worked."""
    return failure_of([sys.executable, "-P", "-c", SCRIPT])


def failure_of(command: Sequence[str], environment: Mapping[str, str] | None = None) -> str | None:
    """The last words of a command that failed; None if it worked."""
    try:
        run = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    except OSError as error:
        return error.strerror or str(error)
    if run.returncode == 0:
        return None
    lines = run.stderr.strip().splitlines()
    return lines[-1] if lines else f"exit code {run.returncode}"
