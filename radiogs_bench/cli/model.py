"""``radiogs-bench train``, ``render`` and ``relight``: one model, outside any suite."""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import DataError, UsageError

from .options import add_effects, add_verbose, positive

if TYPE_CHECKING:
    import torch

    from radiogs_core.scene.camera import Camera
    from radiogs_core.scene.light import EnvironmentMap
    from radiogs_core.scene.scene import Scene

    from .options import Commands

MODES = ("pbr", "finetuned", "surfels")


def add_to(commands: "Commands") -> None:
    """Declare the commands."""
    training = commands.add_parser("train", help="train a model on one scene", allow_abbrev=False)
    training.set_defaults(command=train)
    training.add_argument("scene", metavar="SCENE", help="scene name or folder")
    training.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder to make, or to continue in")
    training.add_argument("--preset", default="tiny", help="budget: smoke, tiny, small, paper (default: tiny)")
    training.add_argument("--seed", type=int, default=0, help="(default: 0)")
    training.add_argument(
        "--profile", choices=["paper", "released"], default="paper", help="whose formulas (default: the paper's)"
    )

    add_effects(training)

    rendering = commands.add_parser("render", help="render a trained model's views", allow_abbrev=False)
    rendering.set_defaults(command=render)
    relighting = commands.add_parser("relight", help="render a trained model under another light", allow_abbrev=False)
    relighting.set_defaults(command=relight)
    relighting.add_argument("--envmap", required=True, type=Path, metavar="FILE", help=".hdr or .exr, lat-long, Z up")
    relighting.add_argument("--mode", choices=MODES, default="pbr", help="(default: pbr)")
    relighting.add_argument(
        "--albedo-scale", type=factors, default=(1.0, 1.0, 1.0), metavar="R,G,B", help="of the albedo (default: 1,1,1)"
    )
    add_effects(relighting)
    for command in (rendering, relighting):
        command.add_argument("folder", type=Path, metavar="DIR", help="where the model was trained")
        command.add_argument("--views", choices=["test", "train"], default="test", help="(default: test)")
    for command in (training, rendering, relighting):
        command.add_argument("--device", choices=["cpu", "cuda"], default="cpu", help="(default: cpu)")
        command.add_argument("--threads", type=positive, metavar="N", help="CPU threads (default: all cores)")
        add_verbose(command)


def factors(text: str) -> tuple[float, float, float]:
    """Three positive numbers separated by commas."""
    try:
        red, green, blue = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not three numbers such as 0.9,1,1.1") from None
    if min(red, green, blue) <= 0:
        raise argparse.ArgumentTypeError(f"'{text}': a factor of an albedo is above zero")
    return red, green, blue


def train(options: argparse.Namespace) -> int:
    """Train, or continue, and write the model."""
    from radiogs.budget import budget
    from radiogs.profile import PROFILES
    from radiogs.variant import Variant
    from radiogs_datasets import load_scene

    from ..engines.run import RADIOGS
    from ..sources import evaluation_code, method_code
    from ..store.folder import Store
    from ..suites.cell import Cell
    from ..training.interruption import Interruption
    from ..training.preflight import read_everything
    from ..training.progress import progress_for_stderr
    from ..training.stages import Bench, trained
    from ..training.trained_folder import write_trained
    from .reporter import say

    device = chosen_device(options)
    preset, scene, store = budget(options.preset), load_scene(options.scene), Store(options.out)
    cell = Cell(
        scene=scene.name,
        checksum=scene.checksum,
        variant=Variant(deviations=PROFILES[options.profile], effects=options.effects),
        budget=preset,
        seed=options.seed,
        device=options.device,
        protocol="default",
        method_code=method_code(),
        evaluation_code=evaluation_code(),
    )
    with progress_for_stderr() as progress, Interruption() as interruption:
        read_everything(scene, lambda done, total: progress.advance(f"reading {scene.name}", done, total))
        model, ledgers = trained(Bench(store, RADIOGS, device, progress, interruption), cell, scene)
    seconds = sum(ledger["seconds"] for ledger in ledgers.values())
    say(f"{scene.name}: {len(model.surfels)} surfels in {seconds:.0f} s")
    if model.plan.off:
        say(f"not, or only in part, simulated: {', '.join(model.plan.off)}")
    for path in write_trained(store, options.scene, cell, model):
        say(f"wrote {path}")
    return 0


def render(options: argparse.Namespace) -> int:
    """Write the maps of every view: images as PNG, everything as EXR."""
    from radiogs.budget import budget
    from radiogs.rendering import Renderer

    from ..training.trained_folder import read_trained, variant_of

    device = chosen_device(options)
    about, model = read_trained(options.folder, device)
    scene = scene_of(about["scene"], about["checksum"])
    renderer = Renderer(model, budget(about["preset"]).incident_samples, variant_of(about["variant"]))
    return write_views(renderer.render, scene, options.views, options.folder / "render", device)


def relight(options: argparse.Namespace) -> int:
    """Write every view under another light."""
    import torch

    from radiogs.budget import budget
    from radiogs.relighting import relit_under
    from radiogs.variant import Variant
    from radiogs_core.contract import Run

    from ..training.trained_folder import read_trained
    from .reporter import say

    device = chosen_device(options)
    light = light_of(options.envmap)
    about, model = read_trained(options.folder, device)
    scene = scene_of(about["scene"], about["checksum"])
    variant = Variant(relighting=options.mode, effects=options.effects)
    run = Run(scene, variant, budget(about["preset"]), about["seed"], device)
    relit = relit_under(model, light, torch.tensor(options.albedo_scale), run)
    for record in relit.evidence:
        say(f"{record.effect}: {record.verdict} ({record.why})")
    folder = options.folder / "relight" / options.envmap.stem / options.mode
    return write_views(relit.render, scene, options.views, folder, device)


def light_of(path: Path) -> "EnvironmentMap":
    """The light in a file. Raises UsageError for one of a kind that holds no radiance."""
    import torch

    from radiogs_core.scene.light import EnvironmentMap
    from radiogs_datasets.image_files import read_exr, read_hdr

    readers = {".hdr": read_hdr, ".exr": read_exr}
    if path.suffix.lower() not in readers:
        raise UsageError(f"{path} is neither .hdr nor .exr", "Light needs linear values above one.")
    return EnvironmentMap(torch.from_numpy(readers[path.suffix.lower()](path)[..., :3]))


def chosen_device(options: argparse.Namespace) -> "torch.device":
    """The device, ready to be worked on with as many threads as asked for. Raises UsageError."""
    import os

    import torch

    from radiogs_core.kernels.runtime import use_threads

    if options.device == "cuda" and not torch.cuda.is_available():
        raise UsageError(
            "no CUDA device was found", "torch sees no GPU, or is a build without CUDA.", "Leave --device cuda out."
        )
    use_threads(options.threads or len(os.sched_getaffinity(0)))
    return torch.device(options.device)


def scene_of(name: str, checksum: str) -> "Scene":
    """The scene that a model was trained on. Raises DataError if it is gone or another one now."""
    from radiogs_datasets import load_scene

    scene = load_scene(name)
    if scene.checksum != checksum:
        raise DataError(
            f"scene '{name}' has changed since the model was trained",
            "Its files have another checksum.",
            "Put the old files back, or train again.",
        )
    return scene


def write_views(
    render: "Callable[[Camera], Mapping[str, torch.Tensor]]",
    scene: "Scene",
    split: str,
    folder: Path,
    device: "torch.device",
) -> int:
    """Render each view of a split into ``folder``: ``<view>.png`` and ``<view>_<map>.exr``; says what a frame took."""
    import statistics

    import torch

    from radiogs_datasets.image_files import write_exr, write_png

    from ..evaluation.frame_cost import frame_milliseconds
    from .reporter import say

    views = scene.test if split == "test" else scene.train
    folder.mkdir(parents=True, exist_ok=True)
    cameras = [view.camera.to(device, torch.float32) for view in views]
    for view, camera in zip(views, cameras, strict=True):
        maps = {name: image.cpu().numpy() for name, image in render(camera).items()}
        name = view.name.replace("/", "_")
        write_png(folder / f"{name}.png", maps.pop("image"))
        for kind, image in maps.items():
            write_exr(folder / f"{name}_{kind}.exr", image)
    times = frame_milliseconds(render, cameras, device)
    say(f"{len(views)} views in {folder}; {statistics.median(times):.2f} ms a frame")
    return 0
