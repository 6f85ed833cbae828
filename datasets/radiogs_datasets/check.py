"""Everything that is wrong with a scene's folder, at once; loading it stops at the first error."""

import hashlib
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import torch

from radiogs_core.errors import DataError, ExplainedError
from radiogs_core.scene.scene import Scene, View

from .cameras.transforms import read_transforms
from .deep_check import deep_findings
from .deep_check.evidence import gather
from .deep_check.poses import equal_poses, poses
from .findings import Finding, grouped, warning
from .image_files import in_unit_range, read_stored
from .image_structure import KNOWN, usual_type
from .options import AS_STORED, SceneOptions
from .registry import load_scene, scene_folder
from .soundness import OF_PHOTOS, Frame, doubtful_coverage, little_evidence, require_trainable

NORMAL_FILE = re.compile(r"normal\.png")

UNIT_TOLERANCE = 0.05
"""How far from one the length of a stored normal may be: 8 bits allow 0.007."""

CAMERAS_THAT_AGREE = 3
"""Training cameras from which on there is a point that they look at."""

PARALLEL = 0.01
"""Mean squared sine of angles between cameras' axes and their mean (about 6 degrees) below which they meet nowhere."""

BAD_SHARE = 0.01
"""Share of a view's pixels that may be bad before it counts: soft edges darken a stored normal."""

Advance = Callable[[int, int], None]


@dataclass(frozen=True)
class Report:
    """The findings of a check; ``scene`` is None if it cannot be loaded."""

    scene: Scene | None
    findings: tuple[Finding, ...]

    @property
    def sound(self) -> bool:
        """Whether nothing stands in the way of using the scene."""
        return not any(finding.severity == "error" for finding in self.findings)


def check_scene(
    name_or_path: str,
    options: SceneOptions = AS_STORED,
    advance: Advance = lambda done, total: None,
    deep: bool = False,
) -> Report:
    """Decode every image below the scene's folder, load the scene as the options say, and look at its views.

    ``deep``: whether cameras, images and maps of a scene without errors are also held against one another
    (``deep_check``). ``advance`` is told (done, total) files, then views. Raises DataError only if there is no such
    folder.
    """
    folder = scene_folder(name_or_path).absolute()
    bits: Bits = defaultdict(lambda: defaultdict(list))
    findings = list(_damaged_files(folder, bits, advance))
    scene: Scene | None = None
    try:
        scene = load_scene(name_or_path, options=options)
    except DataError as error:
        if _sentence(error) not in {finding.what for finding in findings}:
            findings.append(Finding(folder.name, _sentence(error)))
    findings += _mixed_bits(bits)
    if scene is not None:
        findings += [warning(folder.name, repair) for repair in scene.repairs]
        try:
            require_trainable(scene)
        except DataError as error:
            findings.append(Finding(scene.name, _sentence(error)))
        shown = {name.split("/")[1] for view in scene.test for name in view.sources if name.startswith("relit/")}
        without = "has images of the test views, but no environment map: it cannot be relit"
        findings += [warning(light, without) for light in sorted(shown - scene.lights.keys())]
        findings += _views(scene, advance)
        if not deep and len(equal_poses([view.camera for view in (*scene.train, *scene.test)])):
            findings += poses(gather(scene, maps=False))
        if deep and not any(finding.severity == "error" for finding in findings):
            findings += deep_findings(scene, advance)
    return Report(scene, tuple(grouped(findings)))


Bits = dict[str, dict[int, list[str]]]
"""Images by their kind (names alike but for their digits) and their bits a sample."""


def _damaged_files(folder: Path, bits: Bits, advance: Advance) -> Iterator[Finding]:
    """Files that cannot be decoded; what they say of colours matters where a view reads them. ``bits`` is filled."""
    tables = sorted(folder.rglob("transforms*.json"))
    # Hidden files are left out: macOS lays a file ._NAME of its own beside each.
    named = (path for path in folder.rglob("*") if usual_type(path) in KNOWN and path.is_file())
    images = sorted(path for path in named if not any(part[0] == "." for part in path.relative_to(folder).parts))
    for done, path in enumerate([*tables, *images], start=1):
        place = path.relative_to(folder).as_posix()
        try:
            if path.suffix == ".json":
                read_transforms(path)
            else:
                image = read_stored(path, numbers=True)
                if usual_type(path) == "PNG":
                    bits[re.sub(r"\d+", "#", place)][8 * image.itemsize].append(place)
                if NORMAL_FILE.fullmatch(path.name):
                    yield from _not_unit(place, torch.from_numpy(in_unit_range(image)))
        except DataError as error:
            yield Finding(place, _sentence(error))
        advance(done, len(tables) + len(images))


def _not_unit(place: str, image: torch.Tensor) -> Iterator[Finding]:
    """Normals as TensoIR stores them, n / 2 + 1 / 2, where the file's own alpha is full."""
    length = (2 * image[..., :3] - 1).norm(dim=-1)
    inside = image[..., 3] == 1 if image.shape[2] == 4 else length < 1.5
    bad = ((length - 1).abs() > UNIT_TOLERANCE) & inside
    if inside.any() and float(bad.sum()) > BAD_SHARE * float(inside.sum()):
        share = 100 * float(bad.sum()) / float(inside.sum())
        yield Finding(place, f"{share:.0f} % of its normals are not of unit length: is it encoded as n / 2 + 1 / 2?")


def _mixed_bits(bits: Bits) -> Iterator[Finding]:
    """Files of one kind with 8 bits here and 16 there."""
    for depths in bits.values():
        if len(depths) > 1:
            rare = min(depths, key=lambda bits: len(depths[bits]))
            what = f"has {rare} bits a channel, unlike the others of its kind"
            yield from (warning(place, what) for place in depths[rare])


def _views(scene: Scene, advance: Advance) -> Iterator[Finding]:
    views = [*scene.train, *scene.test]
    centre = scene.centre if _look_at_something(scene) else None
    good = []
    for done, view in enumerate(views, start=1):
        try:
            yield from _view(view, centre)
            good.append(view)
        except ExplainedError as error:
            yield Finding(view.name, _sentence(error))
        advance(done, len(views))
    frames: list[Frame] = []
    names: dict[bytes, list[str]] = defaultdict(list)
    for view in good:
        image = view.read("image")
        alpha, valid = (view.read(name) if view.has(name) else None for name in ("alpha", "valid"))
        frames.append(Frame.of(image, alpha, valid))
        names[hashlib.sha256(image.contiguous().numpy().tobytes()).digest()].append(view.name)
        yield from (warning(view.name, said) for said in little_evidence(image, alpha))
        if alpha is not None and frames[-1].whole == 1 and scene.layout in OF_PHOTOS:
            yield warning(view.name, "its alpha or mask is 1 throughout, unlike those of others: every pixel counts")
    for first, *others in names.values():
        if others:
            more = f", as are {len(others) - 1} more" if others[1:] else ""
            yield warning(others[0], f"its image is that of {first}{more}")
    yield from (warning(scene.name, said) for said in doubtful_coverage(scene, frames))


def _look_at_something(scene: Scene) -> bool:
    """Whether the cameras should look at one point: there are several, masks show an object, and axes meet."""
    if scene.surrounded or len(scene.train) < CAMERAS_THAT_AGREE:
        return False
    forward = torch.stack([view.camera.axes[:, 2] for view in scene.train]).double()
    spread = torch.eye(3, dtype=torch.float64) - (forward[:, :, None] * forward[:, None, :]).mean(0)
    return float(torch.linalg.eigvalsh(spread)[0]) > PARALLEL


def _view(view: View, centre: torch.Tensor | None) -> Iterator[Finding]:
    if centre is not None:
        camera = view.camera.to(dtype=torch.float64)
        depth = float(camera.depth_of(centre))
        place = camera.axes.T @ (centre - camera.centre)
        column, row = camera.fx * place[0] / depth + camera.cx, camera.fy * place[1] / depth + camera.cy
        if depth <= 0:
            yield Finding(view.name, "the camera looks away from what the others look at")
        elif not (0 <= column <= camera.width and 0 <= row <= camera.height):
            yield Finding(view.name, "what the cameras look at lies outside this image")
    if view.has("alpha") and not bool((view.read("alpha") > 0).any()):
        yield Finding(view.name, "its mask is empty: no pixel shows the object")


def _sentence(error: ExplainedError) -> str:
    """The three parts of an error in one line: what is wrong, why, and what to do next."""
    parts = (part for part in (error.what, error.why, error.remedy) if part)
    return " ".join(part if part[-1] in ".?" else f"{part}." for part in parts).removesuffix(".")
