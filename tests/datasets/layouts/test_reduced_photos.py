"""Photos are reduced from their levels, quickly, to the area means in linear light; large ones are decoded once."""

import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from captured import write_capture
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.scene.scene import Scene
from radiogs_datasets import image_files, load_scene, reduction
from radiogs_datasets.options import SceneOptions
from radiogs_datasets.reduction import KeptMaps, linear_area_mean
from radiogs_datasets.same_bytes import within


def shares(stored: int, count: int) -> np.ndarray:
    """Share of each of ``stored`` pixels in each of ``count`` larger ones, [count, stored], by their borders."""
    edges = np.arange(count + 1) * stored / count
    low, high = np.maximum(edges[:-1, None], np.arange(stored)), np.minimum(edges[1:, None], np.arange(stored) + 1)
    return np.clip(high - low, 0, None) * count / stored


def expected(light: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    rows, columns = (shares(stored, count) for stored, count in zip(light.shape[:2], size, strict=True))
    return np.einsum("rh,hwc,kw->rkc", rows, light, columns)


@pytest.mark.parametrize("size", [(7, 5), (30, 20), (61, 47), (1, 1), (60, 47)])
@pytest.mark.parametrize("weighted", [False, True])
def test_means_of_levels_are_the_exact_means_over_areas_in_linear_light(size: tuple[int, int], weighted: bool) -> None:
    random = np.random.default_rng(0)
    levels = random.integers(0, 256, (61, 47, 3), dtype=np.uint8)
    weight = random.random((61, 47, 1)).astype(np.float32) if weighted else None
    light = srgb_decode(torch.from_numpy(levels / 255)).numpy() * (1 if weight is None else weight)
    assert linear_area_mean(levels, size, weight) == pytest.approx(expected(light, size), abs=3e-7)


def photo(shape: tuple[int, ...], kind: type) -> np.ndarray:
    height, width = shape[:2]
    smooth = cv2.resize(np.random.default_rng(0).random((6, 6, shape[2])), (width, height))
    return np.rint(smooth * np.iinfo(kind).max).astype(kind)


def capture(folder: Path, ending: str, image: np.ndarray, mask: str = "") -> Scene:
    """Photos of a capture, all replaced by one image, opened at a third of their size."""
    write_capture(folder, every=12)
    names = sorted((folder / "images").iterdir())
    for name in names:
        cv2.imwrite(str(name.with_suffix(ending)), image)
        if ending != ".png":
            name.unlink()
    listed = folder / "sparse/0/images.txt"
    listed.write_text(listed.read_text().replace(".png", ending))
    masks = str(folder / "masks") if mask else None
    for path in (folder / "masks").iterdir() if mask else ():
        cv2.imwrite(str(path.with_suffix(mask)), cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    return load_scene(str(folder), options=SceneOptions(long_side=32, mask_folder=masks))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ending", "kind", "channels", "mask"),
    [
        (".jpg", np.uint8, 3, ""),
        (".jpg", np.uint8, 3, ".png"),
        (".png", np.uint8, 3, ".jpg"),
        (".png", np.uint16, 3, ".png"),
        (".png", np.uint8, 4, ""),
        (".png", np.uint8, 4, ".png"),
    ],
)
def test_photos_of_every_kind_are_reduced_alike(
    tmp_path: Path, ending: str, kind: type, channels: int, mask: str
) -> None:
    scene = capture(tmp_path, ending, photo((96, 96, channels), kind), mask)
    whole = load_scene(str(tmp_path), options=SceneOptions(mask_folder=str(tmp_path / "masks") if mask else None))
    view, stored = scene.train[0], whole.train[0]
    light = srgb_decode(stored.read("image").double()).numpy()
    weight = stored.read("alpha").double().numpy() if stored.has("alpha") else np.ones((96, 96, 1))
    share = expected(weight, (32, 32))
    straight = np.where(share > 0, expected(light * weight, (32, 32)) / np.where(share > 0, share, 1), 0)
    found = view.read("image")
    assert found.numpy() == pytest.approx(srgb_encode(torch.from_numpy(straight)).numpy(), abs=2e-6)
    assert stored.has("alpha") == (bool(mask) or channels == 4)


def test_files_of_a_large_photo_are_decoded_once_and_its_maps_are_the_callers_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reduction, "LARGE", 96 * 96)
    decoded, decode = [], cv2.imdecode

    def counting(data: np.ndarray, flags: int) -> np.ndarray:
        decoded.append(len(data))
        return decode(data, flags)

    view = capture(tmp_path, ".jpg", photo((96, 96, 3), np.uint8), ".png").train[0]
    monkeypatch.setattr(cv2, "imdecode", counting)
    for name in ("image", "alpha"):
        first = view.read(name)
        kept = first.clone()
        first.zero_()
        assert torch.equal(view.read(name), kept)
        assert float(kept.max()) > 0.1
    assert len(decoded) == 2


def test_a_reduced_photo_has_values_where_levels_are_wanted(tmp_path: Path) -> None:
    view = capture(tmp_path, ".jpg", photo((96, 96, 3), np.uint8), ".png").train[0]
    with within(image_files.LEVELS_WANTED, True):
        assert all(torch.equal(view.sources[name](), view.read(name)) for name in ("image", "alpha"))


def test_maps_that_are_kept_take_bounded_memory() -> None:
    kept, calls = KeptMaps(most=1000), []

    def source(number: int) -> Tensor:
        calls.append(number)
        return torch.full((100,), float(number))  # 400 bytes

    sources = [lambda number=number: source(number) for number in range(3)]
    for each in (*sources, sources[2], sources[1], sources[0]):
        kept.read(each)
    assert calls == [0, 1, 2, 0]


@pytest.mark.slow
def test_reading_a_photo_of_16_megapixels_costs_little_more_than_decoding_it(tmp_path: Path) -> None:
    """It cost twenty times as much: every pixel was converted to linear light by itself."""
    write_capture(tmp_path, every=12)
    random = np.random.default_rng(0)
    image = np.clip(photo((4000, 4000, 3), np.uint8) + random.normal(0, 4, (4000, 4000, 3)), 0, 255).astype(np.uint8)
    data = cv2.imencode(".jpg", image)[1]
    decoding = min(seconds(lambda: cv2.imdecode(data, cv2.IMREAD_COLOR)) for _ in range(3))
    for name in (tmp_path / "images").iterdir():
        name.with_suffix(".jpg").write_bytes(data.tobytes())
    listed = tmp_path / "sparse/0/images.txt"
    listed.write_text(listed.read_text().replace(".png", ".jpg"))
    cameras = tmp_path / "sparse/0/cameras.txt"
    cameras.write_text(cameras.read_text().replace(" 96 96 ", " 4000 4000 "))
    first, *others = load_scene(str(tmp_path), options=SceneOptions(long_side=100)).train
    first.read("image")  # what is prepared once
    assert min(seconds(lambda view=view: view.read("image")) for view in others) < 8 * decoding


def seconds(work: Callable[[], object]) -> float:
    """Processor seconds of the work."""
    started = time.process_time()
    work()
    return time.process_time() - started
