"""All errors of a scene's folder at once; loading a scene stops at the first error."""

import hashlib
import os
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import torch

from radiogs_core.errors import DataError, ExplainedError
from radiogs_core.scene.scene import Scene, View

from .cameras.transforms import read_transforms
from .deep_check import deep_findings
from .deep_check.evidence import Advance, gather
from .deep_check.poses import equal_poses, poses
from .findings import Finding, grouped, warning
from .image_files import COARSE, DECODED, LEVELS_WANTED, Decoded, in_unit_range, read_stored
from .image_structure import KNOWN, usual_type
from .options import AS_STORED, SceneOptions
from .registry import load_scene, scene_folder
from .same_bytes import within
from .soundness import OF_PHOTOS, Frame, doubtful_coverage, little_evidence, require_trainable

NORMAL_FILE = re.compile(r"normal\.png")

UNIT_TOLERANCE = 0.05
"""Largest deviation of a stored normal's length from one: 8 bits allow 0.007."""

CAMERAS_THAT_AGREE = 3
"""Fewest training cameras for which a common point of their axes is estimated."""

PARALLEL = 0.01
"""Mean squared sine of angles between cameras' axes and their mean (about 6 degrees) below which they meet nowhere."""

BAD_SHARE = 0.01
"""Share of a view's pixels that may be bad before it counts: soft edges darken a stored normal."""


@dataclass(frozen=True)
class Report:
    """The findings of a check; ``scene`` is None if the scene cannot be loaded."""

    scene: Scene | None
    findings: tuple[Finding, ...]

    @property
    def sound(self) -> bool:
        """Whether nothing prevents the use of the scene."""
        return not any(finding.severity == "error" for finding in self.findings)


READERS = 2
"""Threads that read, and photos in memory. JPEG is decoded in one at a time (``native_output``), all else in both."""


@dataclass(frozen=True)
class Seen:
    """Findings on one view or file, and the files that were decoded for it, with bits a sample (None: damaged)."""

    files: Mapping[Path, int | None]
    damage: Sequence[Finding] = ()
    wrong: Sequence[Finding] = ()
    remarks: Sequence[Finding] = ()
    frame: Frame | None = None
    digest: tuple[bool, bytes] = (True, b"")
    """Whether the digest covers the whole image (not a coarse one), and the SHA-256."""


def check_scene(
    name_or_path: str,
    options: SceneOptions = AS_STORED,
    advance: Advance = lambda done, total: None,
    deep: bool = False,
) -> Report:
    """Load the scene as the options say, look at its views, and decode every other image below its folder once.

    ``deep``: whether cameras, images and maps of a scene without errors are also compared with each other
    (``deep_check``). ``advance`` receives (done, total) files. Raises DataError only if there is no such folder.
    """
    folder = Path(os.path.normpath(scene_folder(name_or_path).absolute()))
    scene: Scene | None = None
    failed: list[Finding] = []
    try:
        scene = load_scene(name_or_path, options=options)
    except DataError as error:
        failed.append(Finding(folder.name, _sentence(error)))
    views = () if scene is None else (*scene.train, *scene.test)
    seen = list(_seen(folder, scene, views, advance))
    findings = [each for one in seen for each in one.damage]
    findings.sort(key=lambda each: (not each.place.endswith(".json"), each.place))
    findings += [each for each in failed if each.what not in {damage.what for damage in findings}]
    findings += _mixed_bits(folder, {path: bits for one in seen for path, bits in one.files.items()})
    if scene is not None:
        findings += _of_scene(scene)
        findings += _of_views(scene, views, seen)
        if not deep and len(equal_poses([view.camera for view in views])):
            findings += poses(gather(scene, maps=False))
        if deep and not any(finding.severity == "error" for finding in findings):
            findings += deep_findings(scene, advance)
    return Report(scene, tuple(grouped(findings)))


def _seen(folder: Path, scene: Scene | None, views: Sequence[View], advance: Advance) -> Iterator[Seen]:
    """Findings on each view, in their order, then on each file that no view has read."""
    # Hidden files are left out: macOS lays a file ._NAME of its own beside each.
    images = (path for path in folder.rglob("*") if usual_type(path) in KNOWN and path.is_file())
    left = {path for path in images if not any(part[0] == "." for part in path.relative_to(folder).parts)}
    left |= {*folder.rglob("transforms*.json")}
    total = len(left)

    def counted(seen: Seen) -> Seen:
        left.difference_update(seen.files)
        advance(total - len(left), total)
        return seen

    centre = scene.centre if scene is not None and _look_at_something(scene) else None
    # Where nothing has coverage, the border's colours are compared pixel by pixel.
    levels = 1 if scene is None or scene.surrounded else COARSE
    with ThreadPoolExecutor(READERS) as pool:
        yield from map(counted, pool.map(partial(_at_view, folder, centre, levels), views))
        yield from map(counted, pool.map(partial(_at_file, folder), sorted(left)))


def _of_scene(scene: Scene) -> Iterator[Finding]:
    """Findings on the loader's repairs, and on what training and relighting lack."""
    yield from (warning(scene.name, repair) for repair in scene.repairs)
    try:
        require_trainable(scene)
    except DataError as error:
        yield Finding(scene.name, _sentence(error))
    shown = {name.split("/")[1] for view in scene.test for name in view.sources if name.startswith("relit/")}
    without = "has images of the test views, but no environment map: it cannot be relit"
    yield from (warning(light, without) for light in sorted(shown - scene.lights.keys()))


def _of_views(scene: Scene, views: Sequence[View], seen: Sequence[Seen]) -> Iterator[Finding]:
    """Findings on single views, and on views compared with each other; ``seen`` begins with the former."""
    yield from (each for one in seen for each in one.wrong)
    names: dict[bytes, list[str]] = defaultdict(list)
    known = [(view, one) for view, one in zip(views, seen, strict=False) if one.frame is not None]
    counts, kinds = Counter(one.digest for _, one in known), {one.digest[0] for _, one in known}
    with within(LEVELS_WANTED, 1):
        for view, one in known:
            again = not one.digest[0] and (len(kinds) > 1 or counts[one.digest] > 1)
            names[_digest(view.sources["image"]()) if again else one.digest[1]].append(view.name)
    for view, one in known:
        yield from one.remarks
        if view.has("alpha") and one.frame is not None and one.frame.whole == 1 and scene.layout in OF_PHOTOS:
            yield warning(view.name, "its alpha or mask is 1 throughout, unlike those of others: every pixel counts")
    for first, *others in names.values():
        if others:
            more = f", as are {len(others) - 1} more" if others[1:] else ""
            yield warning(others[0], f"its image is that of {first}{more}")
    frames = [one.frame for one in seen if one.frame is not None]
    yield from (warning(scene.name, said) for said in doubtful_coverage(scene, frames))


def _at_view(folder: Path, centre: torch.Tensor | None, levels: int, view: View) -> Seen:
    """A look at a view's camera, image and coverage, whose files are decoded once, as levels where they are levels.

    If a coarse image looks doubtful (one colour, little coverage), the whole one is checked.
    """
    wrong = [] if centre is None else list(_aim(view, centre))
    files: Decoded = {}
    with within(DECODED, files), within(LEVELS_WANTED, levels):
        try:
            alpha, valid = (view.sources[name]() if view.has(name) else None for name in ("alpha", "valid"))
            if alpha is not None and not alpha.numpy().any():
                wrong.append(Finding(view.name, "its mask is empty: no pixel shows the object"))
            image = view.sources["image"]()
        except ExplainedError as error:
            bits, damage = _decoded(folder, files)
            if _sentence(error) not in {each.what for each in damage}:
                wrong.append(Finding(view.name, _sentence(error)))
            return Seen(bits, damage, wrong)
    whole = image.shape[:2] == (view.camera.height, view.camera.width)
    covered = alpha
    if alpha is not None and not whole:  # the pixels all of which is covered: an edge mixes colours
        shares = cv2.resize(alpha.numpy(), image.shape[1::-1], interpolation=cv2.INTER_AREA)
        covered = torch.from_numpy(shares > 0.99 * (255 if alpha.dtype == torch.uint8 else 1))[..., None]
    remarks = list(little_evidence(image, covered))
    if remarks and not whole:
        with within(LEVELS_WANTED, 1):
            remarks = list(little_evidence(view.sources["image"](), alpha))
    said = [warning(view.name, each) for each in remarks]
    return Seen(*_decoded(folder, files), wrong, said, Frame.of(image, alpha, valid), (whole, _digest(image)))


def _digest(image: torch.Tensor) -> bytes:
    return hashlib.sha256(image.contiguous().numpy().data).digest()


def _at_file(folder: Path, path: Path) -> Seen:
    """Findings on one file; its colours matter only if a view reads it."""
    files: Decoded = {}
    try:
        if path.suffix == ".json":
            read_transforms(path)
            return Seen({path: None})
        with within(DECODED, files):
            read_stored(path, numbers=True, coarse=not NORMAL_FILE.fullmatch(path.name))
    except DataError as error:
        files.setdefault((path, True, True), error)
    return Seen(*_decoded(folder, files))


def _decoded(folder: Path, files: Decoded) -> tuple[dict[Path, int | None], list[Finding]]:
    """Bits per sample of decoded files, None for damaged ones, and findings on them."""
    bits: dict[Path, int | None] = {}
    damage: list[Finding] = []
    for (path, *_), found in files.items():
        place = path.relative_to(folder).as_posix() if path.is_relative_to(folder) else str(path)
        bits[path] = None if isinstance(found, DataError) else 8 * found.itemsize
        if isinstance(found, DataError):
            damage.append(Finding(place, _sentence(found)))
        elif NORMAL_FILE.fullmatch(path.name):
            damage += _not_unit(place, torch.from_numpy(in_unit_range(found)))
    return bits, damage


def _not_unit(place: str, image: torch.Tensor) -> Iterator[Finding]:
    """Normals as TensoIR stores them, n / 2 + 1 / 2, where the file's own alpha is full."""
    length = (2 * image[..., :3] - 1).norm(dim=-1)
    inside = image[..., 3] == 1 if image.shape[2] == 4 else length < 1.5
    bad = ((length - 1).abs() > UNIT_TOLERANCE) & inside
    if inside.any() and float(bad.sum()) > BAD_SHARE * float(inside.sum()):
        share = 100 * float(bad.sum()) / float(inside.sum())
        yield Finding(place, f"{share:.0f} % of its normals are not of unit length: is it encoded as n / 2 + 1 / 2?")


def _mixed_bits(folder: Path, bits: Mapping[Path, int | None]) -> Iterator[Finding]:
    """Files of one kind (names alike but for their digits) with 8 bits here and 16 there."""
    kinds: dict[str, dict[int, list[str]]] = defaultdict(lambda: defaultdict(list))
    for path in sorted(path for path in bits if usual_type(path) == "PNG" and path.is_relative_to(folder)):
        if (depth := bits[path]) is not None:
            place = path.relative_to(folder).as_posix()
            kinds[re.sub(r"\d+", "#", place)][depth].append(place)
    for depths in kinds.values():
        if len(depths) > 1:
            rare = min(depths, key=lambda bits: len(depths[bits]))
            what = f"has {rare} bits a channel, unlike the others of its kind"
            yield from (warning(place, what) for place in depths[rare])


def _look_at_something(scene: Scene) -> bool:
    """Whether the cameras should look at one point: there are several, masks show an object, and axes meet."""
    if scene.surrounded or len(scene.train) < CAMERAS_THAT_AGREE:
        return False
    forward = torch.stack([view.camera.axes[:, 2] for view in scene.train]).double()
    spread = torch.eye(3, dtype=torch.float64) - (forward[:, :, None] * forward[:, None, :]).mean(0)
    return float(torch.linalg.eigvalsh(spread)[0]) > PARALLEL


def _aim(view: View, centre: torch.Tensor) -> Iterator[Finding]:
    """Whether the camera sees the point that all look at."""
    camera = view.camera.to(dtype=torch.float64)
    depth = float(camera.depth_of(centre))
    place = camera.axes.T @ (centre - camera.centre)
    column, row = camera.fx * place[0] / depth + camera.cx, camera.fy * place[1] / depth + camera.cy
    if depth <= 0:
        yield Finding(view.name, "the camera looks away from what the others look at")
    elif not (0 <= column <= camera.width and 0 <= row <= camera.height):
        yield Finding(view.name, "what the cameras look at lies outside this image")


def _sentence(error: ExplainedError) -> str:
    """The three parts of an error in one line: what is wrong, why, and what to do next."""
    parts = (part for part in (error.what, error.why, error.remedy) if part)
    return " ".join(part if part[-1] in ".?" else f"{part}." for part in parts).removesuffix(".")
