"""What a folder predicts of a scene."""

from collections.abc import Mapping
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from radiogs.scene import Scene, View

from .decoding import read_map
from .files import Found


@dataclass(frozen=True)
class Predictions:
    """Files by view and map; they are read when asked for.

    ``maps[view][map]`` and ``relit[light][view]`` hold what is there. ``missing`` names what belongs to a map that
    other views have; ``absent`` maps and lights that no view has, each with an example of the file looked for;
    ``remarks`` what one must know before reading a score.
    """

    code: str
    maps: Mapping[str, Mapping[str, Found]]
    relit: Mapping[str, Mapping[str, Found]]
    missing: tuple[str, ...]
    absent: tuple[str, ...]
    remarks: tuple[str, ...]

    @property
    def files(self) -> int:
        """How many files there are to score."""
        return sum(map(len, self.maps.values())) + sum(map(len, self.relit.values()))

    def read(self, view: View, coverage: Float[Tensor, "height width 1"]) -> dict[str, Tensor]:
        """Every map of a view as it appears on black. Raises DataError (see ``read_map``)."""
        return {name: read_map(found, view, coverage) for name, found in self.maps[view.name].items()}

    def read_relit(
        self, light: str, view: View, coverage: Float[Tensor, "height width 1"]
    ) -> Float[Tensor, "height width 3"]:
        """The view under another light, display sRGB on black."""
        return read_map(self.relit[light][view.name], view, coverage)


def relightable(scene: Scene) -> dict[str, list[View]]:
    """The test views that the scene gives under each light."""
    lit = {light: [view for view in scene.test if view.has(f"relit/{light}")] for light in scene.lights}
    return {light: views for light, views in lit.items() if views}
