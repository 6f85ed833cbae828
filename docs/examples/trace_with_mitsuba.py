"""Traces the rays of kernel scene Mi through the same surfels by K2 and by Mitsuba's volumetric primitives.

    pip install "radiogs-bench[generate]"
    python docs/examples/trace_with_mitsuba.py [SURFELS] [ROUNDS]

Prints, for meshes and for analytic ellipsoids, seconds of processor time of one thread, their ratio with its 95 %
interval, and how far the two radiances differ. Mitsuba compiles for the processor by LLVM; DRJIT_LIBLLVM_PATH names
its library where it is not found, or where that is too old (15 was; 19 worked).
"""

import sys
from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import torch
from scipy import stats
from scipy.spatial.transform import Rotation

from radiogs_bench.lab.kernels.clock import seconds
from radiogs_bench.lab.kernels.scenes import KernelScene, blob
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.kernels.trace.bvh import SurfelBVH
from radiogs_core.kernels.trace.trace import trace

CPU = torch.device("cpu")
RAYS = 1 << 16
THICKNESS = 0.01
"""Third axis of an ellipsoid, in units of the shorter of a surfel's two."""

SHAPES = ("ellipsoidsmesh", "ellipsoids")


def primitives(scene: KernelScene, shape: str) -> dict[str, Any]:
    """The surfels as thin ellipsoids with the same Gaussian, opacity and harmonics."""
    geometry = scene.geometry
    scale = torch.stack([1 / geometry.axis_u.norm(dim=-1), 1 / geometry.axis_v.norm(dim=-1)], -1)
    axes = torch.stack([geometry.axis_u * scale[:, :1], geometry.axis_v * scale[:, 1:], geometry.normal], -1)
    thin = torch.cat([scale, THICKNESS * scale.amin(-1, keepdim=True)], -1)
    return {
        "type": shape,
        "centers": mi.TensorXf(geometry.centre.numpy()),
        "scales": mi.TensorXf(thin.numpy()),
        "quaternions": mi.TensorXf(Rotation.from_matrix(axes.double().numpy()).as_quat().astype(np.float32)),
        "opacities": mi.TensorXf(geometry.opacity[:, None].numpy()),
        "sh_coeffs": mi.TensorXf(scene.sh.flatten(1).numpy()),
    }


def by_mitsuba(scene: KernelScene, shape: str) -> Callable[[], np.ndarray]:
    """A function that traces all rays; returns radiance [rays, 3]."""
    made = mi.load_dict({"type": "scene", "surfels": primitives(scene, shape)})
    integrator = mi.load_dict({"type": "volprim_rf_basic", "max_depth": 128, "srgb_primitives": False})
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, len(scene.origin))
    start = scene.origin + scene.t_min[:, None] * scene.direction
    begin, towards = (
        [mi.Float(np.ascontiguousarray(axis)) for axis in each.T.numpy()] for each in (start, scene.direction)
    )
    ray = mi.RayDifferential3f(mi.Point3f(*begin), mi.Vector3f(*towards))

    def run() -> np.ndarray:
        radiance = integrator.sample(dr.ADMode.Primal, made, sampler, ray, None, None, mi.Bool(True))[0]
        dr.eval(radiance)
        dr.sync_thread()
        return np.stack([np.array(channel) for channel in radiance], -1)

    return run


def ratio_of_medians(theirs: np.ndarray, ours: np.ndarray, axis: int = -1) -> np.ndarray:
    """The median of their seconds over that of ours: above 1, K2 is faster."""
    return np.median(theirs, axis) / np.median(ours, axis)


def main(surfels: int, rounds: int) -> None:
    """Trace in turn, after a round that compiles kernels, and print."""
    mi.set_variant("llvm_ad_rgb")
    dr.set_thread_count(1)
    use_threads(1)
    scene = blob(inside=True, count=surfels, rays=RAYS)
    tree = SurfelBVH.build(scene.geometry)
    rays = (scene.origin, scene.direction, scene.t_min)

    def ours() -> np.ndarray:
        return trace(tree, scene.geometry, scene.sh, scene.features, *rays).radiance.numpy()

    for shape in SHAPES:
        theirs = by_mitsuba(scene, shape)
        off = theirs() - ours()
        taken = np.array([(seconds(theirs, CPU), seconds(ours, CPU)) for _ in range(rounds)]).T
        spread = stats.bootstrap(taken, ratio_of_medians, paired=True, method="percentile", rng=0)
        sys.stdout.write(
            f"{shape}, {surfels:,} surfels, {RAYS:,} rays: seconds of Mitsuba and of K2 {taken.tolist()}\n"
            f"  ratio {ratio_of_medians(*taken):.2f}, {spread.confidence_interval};"
            f" radiance differs by {np.median(abs(off)):.3f} (median), {off.mean():.3f} (mean)\n"
        )


if __name__ == "__main__":
    main(*map(int, [*sys.argv[1:], *("20000", "5")[len(sys.argv) - 1 :]]))
