"""Scores Stanford-ORB's pairs of output and target under a protocol."""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_baselines.outputs.stanford_orb import Pair
from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_datasets.bounded_reading import as_float32, read_numpy
from radiogs_datasets.image_files import read_image

from ..store.schema import MetricValue
from .metrics.conventions import Task
from .metrics.protocol import Protocol
from .metrics.stanford_orb import StanfordOrb
from .metrics.surface_distance import chamfer, read_mesh
from .metrics.values import Value

SOLID = 0.5

BENCHMARK_SIDE = 512
"""Pixels per side at which Stanford-ORB compares."""


def score_pairs(pairs: Sequence[Pair], rules: Protocol) -> dict[str, MetricValue]:
    """Metrics by ``capture/task/measure``: the mean over the capture's pairs of the task, and each pair's value.

    Targets of another size are resized to the output's by area averaging. Without a mask the whole image counts. Depth
    is aligned over all views of a capture (``score_depths``). Pairs without a target are skipped. An image or albedo
    that is not predicted is white at the benchmark's resolution under ``stanford-orb``, as its evaluator has it, and
    n/a under other protocols; depth, normals and a shape that are not predicted are skipped. Raises DataError for a
    damaged file.
    """
    found: dict[str, list[Value]] = defaultdict(list)
    for pair in pairs:
        if pair.task == "depth" or pair.target is None or (pair.output is None and not pair.counts_as_white):
            continue
        for measure, value in _scores(pair, pair.output, pair.target, rules).items():
            found[f"{pair.capture}/{pair.task}/{measure}"].append(value)
    for name, values in score_depths(pairs, rules).items():
        found[name] = values
    metrics = {}
    for name, values in found.items():
        mean = rules.mean(values)
        metrics[name] = MetricValue(value=mean.value, reason=mean.reason or None, views=[v.value for v in values])
    return metrics


def files_of(pairs: Sequence[Pair]) -> dict[str, dict[str, str]]:
    """Existing targets and the outputs that are compared with them, by ``capture/task``."""
    found: dict[str, dict[str, str]] = defaultdict(dict)
    for pair in pairs:
        output, target = pair.wanted
        if output is not None and not pair.lacking:
            found[f"{pair.capture}/{pair.task}"][target] = output
    return found


def score_depths(pairs: Sequence[Pair], rules: Protocol) -> dict[str, list[Value]]:
    """Scale-invariant depth errors by ``capture/depth/simse``, aligned over all views of a capture."""
    captures: dict[str, list[tuple[Tensor, Tensor, Tensor]]] = defaultdict(list)
    for pair in pairs:
        if pair.task == "depth" and pair.output is not None and pair.target is not None:
            ours = _numbers(pair.output)[..., :1]
            captures[pair.capture].append((ours, _resized(_numbers(pair.target)[..., :1], ours), _mask(pair, ours)))
    found = {}
    for capture, views in captures.items():
        columns = [list(column) for column in zip(*views, strict=True)]
        found[f"{capture}/depth/simse"] = [scores["simse"] for scores in rules.score_depth(*columns)]
    return found


def _scores(pair: Pair, output: Path | None, target: Path, rules: Protocol) -> dict[str, Value]:
    task: Task = "nvs" if pair.task == "nvs" else "relight"
    if output is None:
        if not isinstance(rules, StanfordOrb):
            return rules.no_comparison("the JSON gives null: there is no prediction")
        white = _white(target)
        if pair.task == "albedo":
            return _albedo(pair, white, target, rules)
        return rules.score_linear(white, _resized(_linear(target), white), _mask(pair, white), task)
    if pair.task == "shape":
        return {"chamfer": shape_distance(output, target)}
    if pair.task == "normal":
        ours = _numbers(output)
        return rules.score_normal(ours, _resized(_numbers(target), ours), _mask(pair, ours))
    ours = _linear(output)
    if pair.task == "albedo":
        return _albedo(pair, ours, target, rules)
    if isinstance(rules, StanfordOrb):
        return rules.score_linear(ours, _resized(_linear(target), ours), _mask(pair, ours), task)
    mask = _mask(pair, ours)
    shown = [_displayed(path, ours) * mask for path in (output, target)]
    return rules.score_image(shown[0], shown[1], mask, task=task)


def _albedo(pair: Pair, ours: Float[Tensor, "height width 3"], target: Path, rules: Protocol) -> dict[str, Value]:
    """Scores of linear albedo; the target is display sRGB, whatever the suffix of its file."""
    mask = _mask(pair, ours)
    linear, aimed = ours * mask, srgb_decode(_resized(_numbers(target)[..., :3], ours)) * mask
    return rules.score_albedo(linear, aimed, rules.albedo_scale([linear], [aimed], [mask]), mask)


def _white(target: Path) -> Float[Tensor, "height width 3"]:
    """An image of ones with the target's shape, reduced to the benchmark's resolution if the target is larger."""
    height, width = _numbers(target).shape[:2]
    smaller = min(1.0, BENCHMARK_SIDE / max(height, width))
    return torch.ones(round(smaller * height), round(smaller * width), 3)


def _displayed(path: Path, like: Float[Tensor, "height width 3"]) -> Float[Tensor, "height width 3"]:
    """Display sRGB. A PNG of the right size keeps its 8-bit levels: converting to linear and back would change some."""
    stored = _numbers(path)[..., :3]
    if path.suffix == ".png" and stored.shape == like.shape:
        return stored
    return srgb_encode(_resized(_linear(path), like).clamp(min=0)).clamp(0, 1)


def _linear(path: Path) -> Float[Tensor, "height width 3"]:
    """EXR holds linear radiance, PNG display sRGB."""
    values = _numbers(path)[..., :3]
    return srgb_decode(values) if path.suffix == ".png" else values


def _mask(pair: Pair, like: Float[Tensor, "height width channels"]) -> Float[Tensor, "height width 1"]:
    if pair.mask is None:
        return torch.ones(*like.shape[:2], 1)
    return (_resized(_numbers(pair.mask)[..., :1], like) > SOLID).float()


def _numbers(path: Path) -> Float[Tensor, "height width channels"]:
    if path.suffix != ".npy":
        return torch.from_numpy(read_image(path))
    values = np.atleast_3d(read_numpy(path))
    if values.ndim != 3 or not values.size or not np.issubdtype(values.dtype, np.number):
        raise DataError(f"{path} is no map of numbers", f"It holds {values.dtype} of shape {values.shape}.")
    return torch.from_numpy(as_float32(path, values))


def _resized(image: Tensor, like: Tensor) -> Float[Tensor, "height width channels"]:
    size = (like.shape[1], like.shape[0])
    if (image.shape[1], image.shape[0]) == size:
        return image
    resized = cv2.resize(image.numpy(), size, interpolation=cv2.INTER_AREA)
    return torch.from_numpy(np.atleast_3d(resized))


def shape_distance(output: Path, target: Path) -> Value:
    """The chamfer distance of two mesh files, or the reason why it is missing."""
    try:
        (vertices, faces), (truth, _) = read_mesh(output), read_mesh(target)
    except UsageError as lacking:
        return Value(None, f"{lacking.what}: {lacking.remedy}")
    return Value(chamfer(vertices, faces, truth))
