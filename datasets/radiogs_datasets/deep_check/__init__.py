"""The deep checks of a scene: available evidence, and the order of checks."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from radiogs_core.scene.scene import Scene

from ..findings import Finding
from .evidence import Advance, Evidence, gather
from .exposure import exposure
from .map_agreement import map_agreement
from .matches import epipolar_agreement
from .poses import equal_poses, poses
from .radiance import radiance
from .recorded_lights import recorded_lights
from .reprojection import reprojection
from .shape_maps import shape_maps
from .silhouettes import silhouettes

Check = Callable[[Evidence], Iterator[Finding]]

OF_CAMERAS: tuple[Check, ...] = (poses, silhouettes, reprojection, epipolar_agreement)
"""Checks of cameras, most reliable first: a view that one check has named is not named by the next."""

OF_VALUES: tuple[Check, ...] = (shape_maps, exposure, map_agreement, radiance, recorded_lights)
"""Checks of images and maps. A wrong camera would mislead them, so they are skipped if all cameras are wrong."""

WHOLE_MAPS = {"albedo", "depth", "normal", "roughness"}
"""Places of findings on a map of all test views: a map that is wrong in all views is not used as evidence."""


def short_findings(scene: Scene) -> Iterator[Finding]:
    """The part of the deep checks that is done before a training: poses and outlines, which take no maps.

    A scene without equal poses whose first training view has no coverage has none. Raises DataError for a damaged file.
    """
    outlined = scene.train[0].has("alpha")
    if outlined or len(equal_poses([view.camera for view in (*scene.train, *scene.test)])):
        evidence = gather(scene, maps=False)
        yield from poses(evidence)
        if outlined:
            yield from silhouettes(evidence)


def deep_findings(scene: Scene, advance: Advance = lambda done, total: None) -> Iterator[Finding]:
    """Contradictions between the parts of a scene. Raises DataError for a damaged file."""
    evidence = gather(scene, advance)
    named: set[str] = set()
    for check in OF_CAMERAS:
        found = [] if "all views" in named else [each for each in check(evidence) if each.place not in named]
        named |= {each.place for each in found}
        yield from found
    if "all views" not in named:
        sound = evidence.without(named)
        for check in OF_VALUES:
            found = list(check(sound))
            yield from found
            if wrong := WHOLE_MAPS & {each.place for each in found}:
                left = (replace(one, maps={k: one.maps[k] for k in one.maps if k not in wrong}) for one in sound.truths)
                sound = replace(sound, truths=tuple(left))
