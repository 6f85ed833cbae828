"""A page of one model in 3-D, to turn in a browser: the viewer of the report, alone. It asks for no network."""

from pathlib import Path

from markupsafe import Markup
from numpy.typing import NDArray

from ..files import fresh
from .assets import scripts, styles, templates
from .embedding import content_security_policy, json_for_script
from .surfels import packed

SCRIPTS = ("shared", "theme", "surfels")
STYLES = ("page", "comparison")
MODEL = "model"


def write_viewer(arrays: dict[str, NDArray], title: str, path: Path) -> Path:
    """Write the page of a model's arrays (``surfels/...``, as cells keep them); returns its path. Raises OSError."""
    script, style = scripts(SCRIPTS), styles(STYLES)
    run = {"key": MODEL, "row": MODEL, "name": title}
    text = (
        templates()
        .get_template("viewer.html")
        .render(
            title=title,
            surfels={MODEL: packed(arrays)},
            data=json_for_script({"rows": [{"key": MODEL, "text": title}], "runs": [run]}),
            json_for_script=json_for_script,
            policy=content_security_policy(script, style),
            script=Markup(script),
            style=Markup(style),
        )
    )
    path = fresh(path)
    path.write_text(text, encoding="utf-8")
    return path
