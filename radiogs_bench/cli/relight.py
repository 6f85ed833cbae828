"""``radiogs-bench relight``: the views of a trained model under another light, and a turntable under it."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from radiogs_core.errors import UsageError

from .lights import AS_IT_LIES, NO_LAMPS, Lamps, Placing, placed, placed_lamps
from .options import AS_TRAINED, EffectsChoice, MaybeCount, Opening, no_effects
from .reporter import say
from .values import from_text

if TYPE_CHECKING:
    from radiogs_core.scene.light import EnvironmentMap
    from radiogs_core.scene.scene import Scene

ONLY_MODE = "default"
"""Folder of renders by a method that offers no choice of relighting."""

BY_LAMPS = "lamps"
"""Folder of renders under lamps."""

FRAMES = 36
"""Pictures of a relit turntable."""


def factors(text: str) -> tuple[float, float, float]:
    """Three positive numbers separated by commas."""
    try:
        red, green, blue = (float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"'{text}' is not three numbers such as 0.9,1,1.1") from None
    if not all(0 < factor < math.inf for factor in (red, green, blue)):
        raise ValueError(f"'{text}': a factor of an albedo is finite and above zero")
    return red, green, blue


@dataclass(frozen=True)
class Relighting:
    """Options of how a model is relit, and of the output."""

    mode: str | None = None
    """Choose one of the ways in which the method relights (default: as in the model's settings)."""
    albedo_scale: Annotated[tuple[float, float, float], from_text(factors), Parameter(metavar="R,G,B")] = (1, 1, 1)
    """Multiply the recovered albedo by these factors."""
    effects: EffectsChoice = "all"
    """Simulate all effects, only the needed ones (auto), or the ones in this list."""
    views: Literal["test", "train"] = "test"
    """Render the views of this split."""
    turntable: MaybeCount = None
    """Also write a turntable under the light, relit.gif, as `view` writes one, of N pictures (default: 36)."""


def relight(
    folder: Path,
    /,
    *,
    envmap: Path | None = None,
    lamps: Lamps = NO_LAMPS,
    placing: Placing = AS_IT_LIES,
    asked: Annotated[Relighting, Parameter(name="*")] = Relighting(),
    opening: Opening = AS_TRAINED,
) -> None:
    """Render the views of a trained model under another light.

    Example:  radiogs-bench relight out/corner --envmap sunset

    Lamps:  radiogs-bench relight out/corner --point 0,0,3,40 --sun 45,30

    :param folder: Open the model that `train` left in this folder.
    :param envmap: Relight by this light of the scene, or by this .hdr or .exr file: latitude-longitude, or a cube map
        with a known layout of faces.
    """
    import torch

    from radiogs_core.capabilities import Remarking
    from radiogs_core.own_files import own_folder

    from ..export.views import beyond_levels, count_levels, lit_by_lamps, write_turntable, write_views
    from ..runs.progress import working
    from ..runs.trained_folder import read_about, read_trained
    from ..scoring.rendering import prepared
    from ..store.folder import Store

    device, lit, given = opening.use(), lit_folder(envmap, lamps) + placing.marks, lamps.found()
    if given:
        require_lamps_alone(asked)
    about = read_about(folder)
    name, (mode, changes) = about["method"], changes_of(about["method"], asked, about["variant"])
    with Store(folder).keeping_tracebacks():
        run, model = read_trained(folder, device, changes)
        light, scale = _placed(placing, run.scene, envmap), torch.tensor(asked.albedo_scale, dtype=torch.float32)
        shone, lies = placed_lamps(placing, run.scene, given)
        say(*lies)
        with working(f"preparing {lit}"):
            relit = lit_by_lamps(name, model, shone, light, scale) if shone else prepared(name, model, light, scale)
        if isinstance(relit, Remarking):
            say(*relit.remarks)
        place, levels = own_folder(folder / "relight" / (BY_LAMPS if given else mode), folder), Counter[str]()
        say(write_views(
            name, relit, run, asked.views, place,
            lambda kind: f"{'relit' if kind == 'image' else kind}/{lit}", partial(count_levels, levels),
        ))  # fmt: skip
        say(*beyond_levels(levels))
        if asked.turntable is not None:
            frames = (*asked.turntable, FRAMES)[0]
            say(f"turntable: {write_turntable(name, relit, run, folder, place / 'relit' / lit, frames)}")


def require_lamps_alone(asked: Relighting) -> None:
    """Raise UsageError for options that do not go with lamps."""
    for option, unlike in (("--mode", asked.mode is not None), ("--effects", asked.effects != "all")):
        if unlike:
            raise UsageError(
                f"{option} does not go with lamps",
                "Lamps are traced in one way: a ray from each surfel to each lamp, then bounces, with all effects.",
                f"Leave {option} out.",
            )


def _placed(placing: Placing, scene: "Scene", envmap: Path | None) -> "EnvironmentMap | None":
    """The scene's light of that name, or the one in a file, in the scene's world; prints how it lies there."""
    from radiogs_core.errors import unknown
    from radiogs_datasets.lights import read_light

    from ..scoring.recovered_light import NOT_DISTANT

    if scene.surrounded:
        say(f"relighting means little here: {NOT_DISTANT}")
    if envmap is None:
        return None
    name, named = str(envmap), not (envmap.suffix or envmap.exists())
    if named and name not in scene.lights:
        raise unknown("light", name, scene.lights, "Name one, or an .hdr or .exr file.", of=f"scene '{scene.name}'")
    light, repairs = (scene.lights[name], []) if named else read_light(envmap)
    found, lies = placed(placing, scene, light)
    say(*repairs, f"{envmap.name}: {lies}")
    return found


def changes_of(name: str, asked: Relighting, variant: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """The relighting mode that was chosen, and the fields of a model's variant that are changed. Raises UsageError."""
    mode, changes = chosen_mode(name, asked.mode, variant)
    if "effects" in variant:
        changes["effects"] = asked.effects
    elif asked.effects != "all":
        raise no_effects(name)
    return mode, changes


def chosen_mode(name: str, mode: str | None, variant: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """The chosen relighting mode of a method, and the field of the variant that holds it.

    Without a choice it is the mode in the model's ``variant`` (plain values), else the method's default. Raises
    UsageError for a mode that the method does not offer.
    """
    from radiogs_core.capabilities import RelitInModes
    from radiogs_core.errors import unknown
    from radiogs_core.plain_values import flat

    from ..methods import method

    used = method(name)
    if not isinstance(used, RelitInModes):
        if mode is not None:
            raise UsageError(f"{used.name} relights in one way alone", "", "Leave --mode out.")
        return ONLY_MODE, {}
    modes = used.relighting_modes
    if mode is not None and mode not in modes.titles:
        raise unknown("relighting mode", mode, modes.titles, of=used.name)
    chosen = flat(variant).get(modes.field, modes.default) if mode is None else mode
    return chosen, {modes.field: chosen}


def lit_folder(envmap: Path | None, lamps: Lamps) -> str:
    """Name of the folder for renders, from the names of the map, the lamps' file and each lamp. Raises UsageError."""
    from radiogs_datasets.bounded_reading import LONGEST_NAME

    files = (each for each in (envmap, lamps.light) if each is not None)
    name = "+".join([*map(file_folder, files), *lamps.names])
    if not name:
        raise UsageError("no light is given", "", "Give --envmap, --light, --point, --spot or --sun, or several.")
    if len(name) > LONGEST_NAME:
        what = f"the lights have a name of {len(name)} letters"
        raise UsageError(what, "Renders are stored under it.", "Write lamps into a file: --light FILE.")
    return name


def file_folder(light: Path) -> str:
    """A file's part of ``lit_folder``: its name, plus its ending if an x.hdr lies beside an x.exr, or an x.toml beside
    an x.json."""
    from radiogs_datasets.bounded_reading import require_storable

    if light.stem.strip(".") == "":
        raise UsageError(f"{light} has no name to store renders under", "", "Rename the file.")
    require_storable(light.name, "the light")
    ending = light.suffix.lower()
    two = ending in OTHERS and light.with_suffix(OTHERS[ending]).exists()
    return f"{light.stem}_{ending[1:]}" if two else light.stem


OTHERS = {".exr": ".hdr", ".json": ".toml"}
"""Endings of files whose names may collide, each with the ending of the other file."""
