"""The schema of a stored result, key by key. Strict JSON; a missing number is null and has a reason.

The version rises when a key changes its meaning or is removed, or when a reader needs a new key. docs/start.md
describes every key, and CHANGELOG.md the changes of versions.
"""

import math
from collections.abc import Mapping
from typing import Any, NotRequired, TypedDict

from ..sources import GitState
from .shapes import mismatch

RESULT_SCHEMA = "radiogs-bench/result/6"


class MetricValue(TypedDict):
    """One metric of a cell: the mean over its test views (for relighting: over lights, then views)."""

    value: float | None
    """The value; None if it is missing or not finite."""
    reason: str | None
    """Why the value is missing."""
    views: list[float | None]
    """The value of each test view, in the order of the result's ``views``; None for a view without one."""


class TrailPoint(TypedDict):
    """Losses and metrics of a stage after ``iteration`` steps."""

    iteration: int
    seconds: float
    """Seconds of the stage so far; the clock is paused while the model is scored."""
    losses: dict[str, float]
    """Weighted losses by name, each the mean over the steps since the previous point."""
    metrics: dict[str, float]
    """Metrics by ``task/measure`` over a few test views; empty if the model was not scored."""


class FirstStep(TypedDict):
    """One of the first steps of a stage (see ``runs.training_curves``)."""

    iteration: int
    """Steps taken, with this one."""
    losses: dict[str, float]
    """Weighted losses of this step by name."""
    gradients: dict[str, float]
    """Euclidean length of each learnt tensor's gradient, by the tensor's name; empty where the stage offers none."""
    updates: dict[str, float]
    """Euclidean length of what the step added to each tensor; empty where the stage offers none."""


class Machine(TypedDict):
    """The machine that a process ran on; times from different machines are not comparable."""

    system: str
    cpu: str
    instructions: NotRequired[str]
    """A digest of what the processor can do; absent in results of earlier versions."""
    cores: int | None
    memory_bytes: int
    gpu: str | None
    threads: int
    """Threads of the kernels."""


class Session(TypedDict):
    """A process that contributed to a result; there are several if a run was interrupted and continued."""

    date: str
    """UTC, ISO 8601."""
    git: GitState | None
    """State of the harness's own repository; None for an installed package."""
    versions: dict[str, str]
    """Python and every library whose version can change a digit."""
    machine: Machine
    peak_memory_bytes: dict[str, int]
    """Peaks of this process during the stage: ``host``, resident set; ``device``, CUDA allocator (with a GPU)."""
    yardstick: NotRequired[float]
    """Seconds of a fixed computation on the device just after the stage (``provenance.yardstick_seconds``); absent in a
    session that did not end a stage, and in results of earlier versions."""


class Determined(TypedDict):
    """How well the training images determine a recovered quantity (see ``scoring.what_images_determine``)."""

    value: float
    """Recovered value (``radiogs_core.capabilities.Varying.values``)."""
    step: float
    """Amount by which the quantity was changed, upwards and downwards."""
    views: int
    """Training views that were compared."""
    error: float
    """Squared error of their images, display sRGB, per covered pixel."""
    rise: float
    """Rise of the error by a step: half the second difference over the three amounts."""
    decibels: float
    """The same increase in decibels."""
    rise_free: NotRequired[float]
    """Upper bound on the increase if everything else may compensate the change; at most ``rise``. Absent where the
    method does not offer the measurement, and in results of earlier versions."""
    decibels_free: NotRequired[float]
    """``rise_free`` in decibels; present with it."""
    offset: float | None
    """The change at which the error is lowest, by the parabola; None where ``rise`` is below half a level of 8 bits."""
    half_width: float | None
    """Half the width of the offset's 95 % jackknife interval over views; None without an interval."""
    determined: bool
    """Whether ``rise``, and ``rise_free`` where it is known, are above half a level of 8 bits, and the offset's whole
    interval lies within a step of zero."""


class StageName(TypedDict):
    """A stage of training: the name that results use, and the title for people."""

    name: str
    title: str


class Data(TypedDict):
    """The size of what a cell was made from."""

    layout: str
    width: int
    """Size of the first test view, pixels."""
    height: int
    training_views: int
    """Number of the scene's training views; a variant may use a share of them."""
    test_views: int


class Result(TypedDict):
    """A finished cell. ``<key>.npz`` beside it holds the maps of one test view (see ``evaluate``)."""

    schema: str
    key: str
    scene: str
    cell: dict[str, Any]
    """The content that the key is a hash of: checksum, loader, method, variant, budget, seed, device, protocol, keys of
    the stages, and code digests."""
    protocol: dict[str, Any]
    """The conventions of the metric protocol, spelled out."""
    metrics: dict[str, MetricValue]
    """Metrics by ``task/measure``."""
    timings: dict[str, MetricValue]
    """Costs by ``task/ms`` (milliseconds per frame) and ``task/megabytes`` (peak memory of a frame); separate from the
    metrics, because they differ between any two runs."""
    data: NotRequired[Data]
    """Absent in results of earlier versions, and where the test views are not compared."""
    views: list[str]
    """Names of the test views, then of views elsewhere that were scored."""
    shown_view: str | None
    """The view whose maps are in the array file; None without maps (``stability`` stores curves)."""
    shown_light: str | None
    """The light of the relit map in the array file; None for a scene without other lights."""
    albedo_scale: list[float] | None
    """Per channel factor that aligns the recovered albedo with the true one; relighting uses it too. None without true
    albedo (relighting then uses 1)."""
    facts: dict[str, Any]
    """The method's facts about its trained model (``radiogs_core.contract.Trained.facts``), such as ``surfels``, their
    number; RadioGS adds ``effects``: the plan, and the evidence for it."""
    recovered: dict[str, float]
    """``roughness``: the mean of what was recovered, inside the mask and over the test views; absent without the map,
    and the whole key in results of earlier versions."""
    determined: dict[str, Determined]
    """How well the images determine what was recovered, by quantity (``radiogs_core.capabilities.QUANTITIES``); empty
    where the method does not offer the measurement. Absent in results of earlier versions."""
    maps: list[str]
    """Maps that the method gave of the test views, and ``environment`` if it recovered a light; empty if no method was
    scored."""
    stages: list[StageName]
    """The stages of training, in order."""
    losses: dict[str, dict[str, float]]
    """The last step's weighted losses, by stage and name."""
    trail: dict[str, list[TrailPoint]]
    """The losses, by stage, at geometrically spaced steps (see ``runs.training_curves``)."""
    first_steps: NotRequired[dict[str, list[FirstStep]]]
    """The first steps of each stage, one by one; absent in results of earlier versions, and without training."""
    seconds: dict[str, float]
    """Wall-clock seconds by stage, and of ``evaluate``; work lost to a crash does not count. A stage that several cells
    share counts for each of them."""
    parts: dict[str, dict[str, float]]
    """Seconds that named parts of a stage took, by stage (``radiogs_core.instruments.part``)."""
    work: dict[str, dict[str, int]]
    """Deterministic work counters by stage: rays, node visits, hits, blended pairs, shaded samples."""
    guards: dict[str, dict[str, int]]
    """How often each guard of docs/stability.md acted, by stage."""
    sessions: dict[str, list[Session]]
    """Contributing processes by stage, oldest first."""
    arrays: NotRequired[str]
    """SHA-256 of the array file's bytes. The store adds it, and the seal; every stored result has both."""
    seal: NotRequired[str]
    """See ``seal``."""


class Conventions(TypedDict):
    """The conventions of a protocol that reports read by name; there are more."""

    name: str
    title: NotRequired[str]
    albedo: NotRequired[dict[str, Any]]


def contradiction(result: Result) -> str:
    """The first inconsistency of a result with right types in its protocol, stages or sessions; empty if consistent."""
    if wrong := mismatch(result["protocol"], Conventions):
        return f"protocol: {wrong}"
    for stage in (each["name"] for each in result["stages"]):
        for table in ("losses", "trail", "seconds", "parts", "work", "guards", "sessions"):
            if stage not in result[table]:
                return f"{table} lacks stage {stage!r:.80}"
    for stage, sessions in result["sessions"].items():
        if not all("host" in session["peak_memory_bytes"] for session in sessions):
            return f"a session of stage {stage!r:.80} lacks the peak of memory 'host'"
    return ""


class Failure(TypedDict):
    """Why a cell did not finish, the last time it was tried."""

    schema: str
    key: str
    scene: str
    cell: dict[str, Any]
    what: str
    why: str
    remedy: str
    exit_code: int
    date: str
    seal: NotRequired[str]
    """The store adds it (see ``seal``)."""


def values_of(result: Result) -> dict[str, MetricValue]:
    """Metrics, timings and training costs by column: the values of a cell that a table can show.

    ``training/megabytes``: the largest peak over the sessions of all training stages, on the GPU if there is one, else
    of the process.
    """
    amount = training_memory(result)
    memory = {} if amount is None else {"training/megabytes": MetricValue(value=amount / 1e6, reason=None, views=[])}
    return memory | result["metrics"] | result["timings"]


def known_values(metrics: Mapping[str, MetricValue]) -> dict[str, float]:
    """The values that are not missing, by metric."""
    return {name: each["value"] for name, each in metrics.items() if each["value"] is not None}


def training_memory(result: Result) -> int | None:
    """Peak memory of training, bytes; None if no session recorded it."""
    peaks = [
        session["peak_memory_bytes"]
        for stage, sessions in result["sessions"].items()
        if stage != "evaluate"
        for session in sessions
    ]
    return max((peak.get("device", peak["host"]) for peak in peaks), default=None)


def training_seconds(result: Result) -> float:
    """Seconds of all stages but the evaluation."""
    return math.fsum(seconds for stage, seconds in result["seconds"].items() if stage != "evaluate")
