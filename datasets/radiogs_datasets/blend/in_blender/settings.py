"""Cycles so that a picture's mean is the light that the scene sends: nothing clamped, blurred, denoised or left out."""

from typing import Any

import bpy

from .errors import Unusable

LAYER = "layer"
"""Name given to the view layer, and so the first part of the names of a file's channels."""

UNBIASED = {
    "use_denoising": False,
    "use_adaptive_sampling": False,
    "sample_clamp_direct": 0.0,
    "sample_clamp_indirect": 0.0,
    "light_sampling_threshold": 0.0,
    "blur_glossy": 0.0,
    "use_fast_gi": False,
    "use_guiding": False,
    "caustics_reflective": True,
    "caustics_refractive": True,
    "film_exposure": 1.0,
    "film_transparent_glass": False,
    "pixel_filter_type": "BOX",
    "sampling_pattern": "TABULATED_SOBOL",
    "use_animated_seed": False,
    "auto_scrambling_distance": False,
    "scrambling_distance": 1.0,
    "use_camera_cull": False,
    "use_distance_cull": False,
    "texture_limit_render": "OFF",
    "shading_system": False,
    "direct_light_sampling_type": "MULTIPLE_IMPORTANCE_SAMPLING",
}
"""Settings of ``scene.cycles`` by name. Roulette stays: it is unbiased. OSL (``shading_system``) would run scripts."""

PASSES = (
    "combined", "normal", "emit", "diffuse_direct", "diffuse_indirect", "diffuse_color", "glossy_direct",
    "glossy_indirect", "glossy_color", "transmission_direct", "transmission_indirect", "transmission_color",
)  # fmt: skip
VOLUME_PASSES = ("volume_direct", "volume_indirect")


def prepare(device: str, threads: int) -> None:
    """Everything that does not change from picture to picture. Raises Unusable where the device is not there."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    for name, value in UNBIASED.items():
        setattr(scene.cycles, name, value)
    render = scene.render
    render.film_transparent = True
    render.use_motion_blur = render.use_simplify = render.use_border = False
    render.use_compositing = render.use_sequencer = render.use_freestyle = False
    render.resolution_percentage = 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    render.dither_intensity = 0.0
    render.use_file_extension = render.use_overwrite = True
    render.use_persistent_data = True
    render.threads_mode, render.threads = "FIXED", threads
    scene.view_settings.view_transform, scene.view_settings.look = "Raw", "None"
    scene.view_settings.exposure, scene.view_settings.gamma = 0.0, 1.0
    written = render.image_settings
    if hasattr(written, "media_type"):  # since Blender 5.0
        written.media_type = "MULTI_LAYER_IMAGE"
    written.file_format, written.color_depth, written.exr_codec = "OPEN_EXR_MULTILAYER", "32", "ZIP"
    for layer in scene.view_layers[1:]:
        layer.use = False
    layer = scene.view_layers[0]
    layer.name, layer.use = LAYER, True
    layer.samples = 0
    layer.material_override = layer.world_override = None
    for name in PASSES:
        setattr(layer, f"use_pass_{name}", True)
    for name in VOLUME_PASSES:
        setattr(layer.cycles, f"use_pass_{name}", True)
    for thing in scene.objects:
        if thing.type == "LIGHT":
            thing.hide_render = True
    _choose(scene, device)


def _choose(scene: Any, device: str) -> None:
    if device == "cpu":
        scene.cycles.device = "CPU"
        return
    preferences = bpy.context.preferences.addons["cycles"].preferences
    for kind in ("OPTIX", "CUDA"):
        try:
            preferences.compute_device_type = kind
        except TypeError:  # this Blender was built without it
            continue
        preferences.get_devices()
        found = [each for each in preferences.devices if each.type == kind]
        if found:
            for each in preferences.devices:
                each.use = each.type == kind
            scene.cycles.device = "GPU"
            return
    raise Unusable("Blender finds no CUDA device", "Cycles asked OptiX and CUDA for devices; neither has one.",
                   "Leave --device out to render on the CPU.")  # fmt: skip
