"""Documents that pdflatex compiles."""

import shutil
import subprocess
from pathlib import Path

import pytest


def pdflatex(name: str, folder: Path) -> str:
    """The output of pdflatex for a document that it can print; skips without pdflatex or siunitx."""
    if shutil.which("pdflatex") is None or shutil.which("kpsewhich") is None:
        pytest.skip("pdflatex is not installed (make extras)")
    if subprocess.run(["kpsewhich", "siunitx.sty"], capture_output=True, check=False).returncode != 0:
        pytest.skip("LaTeX's package siunitx is not installed (make extras)")
    made = subprocess.run(
        ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", name],
        cwd=folder, capture_output=True, encoding="latin-1", check=False,
    )  # fmt: skip
    assert made.returncode == 0, made.stdout[-2000:]
    return made.stdout
