"""Where L_rad costs on a scene without inter-reflection: stage 2 over the reconstruction, and over the true solids.

    python docs/examples/true_geometry.py [SCENE] [SEED] [N_s] [PRESET]

Trains with and without L_rad on both geometries (preset tiny, one thread, some seven minutes), and prints how much of
the cosine-weighted hemisphere of the surfels is blocked, how bright what blocks it is, and the scores.
"""

import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import torch

from radiogs.method import RADIOGS
from radiogs.model import Model
from radiogs.settings import Variant
from radiogs_bench.scoring.evaluate import SCORES_ALONE, evaluate
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_core.contract import Run
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_core.transport.splatting import shade_surfels
from radiogs_core.transport.tracer import SurfelTracer, gather_incident
from radiogs_datasets import load_scene

CPU = torch.device("cpu")
SCORES = ("nvs/psnr", "indirect/psnr", "albedo/psnr", "relight/psnr", "roughness/mse")


@torch.no_grad()
def blocked(model: Model) -> tuple[float, float, float]:
    """The blocked share of the hemisphere, the mean L_ind over all of it, and L_ind if all surfels were consistent."""
    surfels = model.surfels
    normal = surfels.frame[..., 2]

    def indirect(among: Surfels) -> tuple[float, float]:
        incident = gather_incident(SurfelTracer(among), among, 64, None)
        cosine = (incident.direction * normal[:, None]).sum(-1).clamp(min=0) * incident.weight
        share = float((cosine * (1 - incident.visibility)).sum() / cosine.sum())
        return share, float((cosine * incident.radiance.mean(-1)).sum() / cosine.sum())

    incident = gather_incident(SurfelTracer(surfels), surfels, 64, None)
    sent = shade_surfels(surfels, surfels.albedo, incident, normal[:, None], model.environment)[:, 0].sum(1)
    sh = torch.cat([radiance_to_sh(sent)[:, None], torch.zeros_like(surfels.sh[:, 1:])], 1)
    share, arriving = indirect(surfels)
    return share, arriving, indirect(Surfels.of(surfels.parameters() | {"sh": sh}))[1]


def product_of(place: int, run: Run, before: Mapping[str, Any]) -> dict[str, Any]:
    """The product of a stage of RadioGS after all its steps."""
    stage = RADIOGS.stages(run.variant, run.budget)[place].begin(run, before)
    while stage.iteration < stage.iterations:
        stage.step()
    return stage.product()


def main(name: str = "convex", seed: str = "0", samples: str = "32", preset: str = "tiny") -> None:
    """Train, and print one line per model."""
    use_threads(1)
    cost = replace(RADIOGS.presets[preset], incident_samples=int(samples))
    run = Run(load_scene(name), Variant(), cost, int(seed), CPU)
    first = product_of(0, run, {})
    full = Variant()
    starts = {"reconstruction": full, "true solids": RADIOGS.with_given(full, ("geometry",))}
    for geometry, variant in starts.items():
        for weight in (full.radiometric_weight, 0.0):
            varied = replace(run, variant=replace(variant, radiometric_weight=weight))
            trained = RADIOGS.restore(varied, product_of(1, varied, first))
            rules = protocol("default")
            metrics = evaluate(trained, run.scene, rules, CPU, lambda done, total: None, scope=SCORES_ALONE).metrics
            scores = ", ".join(f"{key} {metrics[key]['value']:.3f}" for key in SCORES)
            share, arriving, consistent = blocked(trained.model)
            line = f"{geometry}, lambda_rad {weight}: {scores}; blocked {share:.4f}, L_ind {arriving:.4f}"
            sys.stdout.write(f"{line}, consistent {consistent:.4f}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
