"""What a folder predicts of a scene."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View

from .decoding import read_environment, read_map
from .files import Found


@dataclass(frozen=True)
class Predictions:
    """Files by view and map; they are read when asked for.

    ``maps[view][map]`` and ``relit[light][view]`` hold what is there. ``missing`` names what belongs to a map that
    other views have; ``absent`` maps and lights that no view has, each with an example of the file looked for;
    ``ignored`` what is there and not read, with the reason where it has one; ``remarks`` what one must know before
    reading a score.
    """

    folder: Path
    code: str
    maps: Mapping[str, Mapping[str, Found]]
    relit: Mapping[str, Mapping[str, Found]]
    light: Path | None
    missing: tuple[str, ...]
    absent: tuple[str, ...]
    ignored: tuple[str, ...]
    remarks: tuple[str, ...]

    @property
    def files(self) -> dict[str, dict[str, str]]:
        """Paths relative to the folder: by map and view, then by ``relit/<light>`` and view, then the light."""
        named: dict[str, dict[str, str]] = {}
        for view, maps in self.maps.items():
            for name, found in maps.items():
                named.setdefault(name, {})[view] = self._relative(found.path)
        for light, views in self.relit.items():
            named[f"relit/{light}"] = {view: self._relative(found.path) for view, found in views.items()}
        if self.light is not None:
            named["environment"] = {"": self._relative(self.light)}
        return named

    def read(self, view: View, coverage: Float[Tensor, "height width 1"]) -> dict[str, Tensor]:
        """Every map of a view as it appears on black. Raises DataError (see ``read_map``)."""
        files = self.maps[view.name]
        alpha = {"alpha": read_map(files["alpha"], view, coverage)} if "alpha" in files else {}
        own = alpha.get("alpha", coverage)
        others = {name: read_map(found, view, coverage, own) for name, found in files.items() if name != "alpha"}
        return others | alpha

    def read_relit(
        self, light: str, view: View, coverage: Float[Tensor, "height width 1"]
    ) -> Float[Tensor, "height width 3"]:
        """The view under another light, display sRGB on black."""
        return read_map(self.relit[light][view.name], view, coverage)

    def read_light(self) -> EnvironmentMap | None:
        """The recovered light, if the folder has it. Raises DataError for a damaged file."""
        return None if self.light is None else read_environment(self.light)

    def _relative(self, path: Path) -> str:
        return path.relative_to(self.folder).as_posix()


def relightable(scene: Scene) -> dict[str, list[View]]:
    """The test views that the scene gives under each light."""
    lit = {light: [view for view in scene.test if view.has(f"relit/{light}")] for light in scene.lights}
    return {light: views for light, views in lit.items() if views}
