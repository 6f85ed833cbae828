"""Temporary."""

from radiogs_core.transport.plan import plan_of

from .relighting import relight


def relit_under(model, light, albedo_scale, run, after_step):
    cameras = [view.camera for view in run.scene.train]
    import torch

    cameras = [view.camera.to(run.device, torch.float32) for view in run.scene.train]
    return relight(
        model,
        light,
        albedo_scale,
        cameras,
        run.budget,
        run.seed,
        run.variant.relighting,
        plan_of(run.variant.effects),
        after_step,
    ), ()
