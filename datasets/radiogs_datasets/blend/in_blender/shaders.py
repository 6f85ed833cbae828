"""Translates shader nodes to the paper's BRDF: albedo, roughness, and weights of features that it cannot express."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from .features import WEIGHTS
from .values import Arithmetic, Colour, Scalar

DIELECTRIC = 0.04
"""F0 of the BRDF."""


@dataclass
class Said:
    """A surface as parameters of the BRDF; absent features have weight 0."""

    albedo: Colour
    roughness: Scalar = 1.0
    features: dict[str, Scalar] = field(default_factory=dict)


class NotUnderstood(Exception):
    """A node tree has a node that cannot be translated; its type is the message."""


def surface(socket: Any, maths: Arithmetic) -> Said:
    """The shader that is linked to an input; black if nothing is linked."""
    if not socket.is_linked:
        return Said((0.0, 0.0, 0.0))
    node = socket.links[0].from_node
    if node.mute:
        raise NotUnderstood(f"{node.bl_idname} (muted)")
    if node.bl_idname == "NodeReroute":
        return surface(node.inputs[0], maths)
    if node.bl_idname not in SHADERS:
        raise NotUnderstood(node.bl_idname)
    said = SHADERS[node.bl_idname](node, maths)
    normal = node.inputs.get("Normal")
    if normal is not None and normal.is_linked:
        said.features["normal_map"] = 1.0
    return said


def _principled(node: Any, maths: Arithmetic) -> Said:
    weights = {name: maths.scalar(node.inputs[given]) for name, given in WEIGHTS.items() if given in node.inputs}
    weights["transparent"] = maths.rest(maths.scalar(node.inputs["Alpha"]))
    weights["other_specular"] = float(not _dielectric(node))
    strength = node.inputs["Emission Strength"]
    weights["emissive"] = float(strength.is_linked or strength.default_value > 0)
    albedo = maths.colour(node.inputs["Base Color"])
    for taken in ("metallic", "transmission"):
        albedo = maths.scaled(albedo, maths.rest(weights[taken]))
    return Said(albedo, maths.scalar(node.inputs["Roughness"]), weights)


def _dielectric(node: Any) -> bool:
    """Whether a Principled BSDF has the reflectance DIELECTRIC at normal incidence, without a tint."""
    index, level, tint = (node.inputs[name] for name in ("IOR", "Specular IOR Level", "Specular Tint"))
    if index.is_linked or level.is_linked or tint.is_linked:
        return False
    normal = ((index.default_value - 1) / (index.default_value + 1)) ** 2 * 2 * level.default_value
    return abs(normal - DIELECTRIC) < 1e-3 and all(abs(each - 1) < 1e-3 for each in tuple(tint.default_value)[:3])


def _diffuse(node: Any, maths: Arithmetic) -> Said:
    return Said(
        maths.colour(node.inputs["Color"]),
        features={"no_specular": 1.0, "rough_diffuse": maths.scalar(node.inputs["Roughness"])},
    )


def _glossy(node: Any, maths: Arithmetic) -> Said:
    return Said((0.0, 0.0, 0.0), maths.scalar(node.inputs["Roughness"]), {"metallic": 1.0})


def _black(feature: str) -> Callable[[Any, Arithmetic], Said]:
    return lambda node, maths: Said((0.0, 0.0, 0.0), features={feature: 1.0})


def _mix(node: Any, maths: Arithmetic) -> Said:
    share = maths.scalar(node.inputs[0])
    first, second = (surface(node.inputs[place], maths) for place in (1, 2))
    if first.features == {"transparent": 1.0} or second.features == {"transparent": 1.0}:
        # A cut-out: what there is of a surface has the material of the other.
        there = second if first.features == {"transparent": 1.0} else first
        there.features["transparent"] = share if there is first else maths.rest(share)
        return there
    return Said(
        maths.mixed(share, first.albedo, second.albedo),
        maths.mixed(share, first.roughness, second.roughness),
        {
            name: maths.mixed(share, first.features.get(name, 0.0), second.features.get(name, 0.0))
            for name in first.features.keys() | second.features.keys()
        },
    )


def _add(node: Any, maths: Arithmetic) -> Said:
    """Add two surfaces; the roughness is the smaller one if both are numbers, else the first that is linked."""
    first, second = (surface(node.inputs[place], maths) for place in (0, 1))
    rough = first.roughness
    if isinstance(first.roughness, float) and isinstance(second.roughness, float):
        rough = min(first.roughness, second.roughness)
    elif isinstance(first.roughness, float):
        rough = second.roughness
    lobes = {*first.features, *second.features}
    features = {name: first.features.get(name) or second.features.get(name, 0.0) for name in lobes}
    return Said(maths.added(first.albedo, second.albedo), rough, features)


SHADERS: dict[str, Callable[[Any, Arithmetic], Said]] = {
    "ShaderNodeBsdfPrincipled": _principled,
    "ShaderNodeBsdfDiffuse": _diffuse,
    "ShaderNodeBsdfAnisotropic": _glossy,
    "ShaderNodeBsdfGlossy": _glossy,
    "ShaderNodeBsdfMetallic": _glossy,
    "ShaderNodeBsdfGlass": _black("transmission"),
    "ShaderNodeBsdfRefraction": _black("transmission"),
    "ShaderNodeBsdfTranslucent": _black("transmission"),
    "ShaderNodeBsdfTransparent": _black("transparent"),
    "ShaderNodeBsdfSheen": _black("sheen"),
    "ShaderNodeSubsurfaceScattering": _black("subsurface"),
    "ShaderNodeEmission": _black("emissive"),
    "ShaderNodeMixShader": _mix,
    "ShaderNodeAddShader": _add,
}
"""How each kind of shader is translated, by the name of its node."""
