"""Blender's materials in the words of the paper's BRDF, without Blender."""

from typing import Any

import pytest

from datasets.blend.node_trees import Node, Socket, Tree, leads_to, shader, texture, value_of
from radiogs_datasets.blend.in_blender.features import FEATURES
from radiogs_datasets.blend.in_blender.shaders import NotUnderstood, surface
from radiogs_datasets.blend.in_blender.values import Arithmetic


def said(node: Node) -> tuple[Any, Any, dict[str, float]]:
    """Albedo, roughness, and the features that are there, as values."""
    found = surface(leads_to(node), Arithmetic(Tree()))
    features = {name: value_of(weight) for name, weight in found.features.items()}
    assert features.keys() <= set(FEATURES)
    return (
        value_of(found.albedo),
        value_of(found.roughness),
        {name: weight for name, weight in features.items() if weight},
    )


def principled(**given: Any) -> Node:
    return shader("ShaderNodeBsdfPrincipled", **given)


def test_a_dielectric_is_translated_completely() -> None:
    assert said(principled()) == ((0.6, 0.4, 0.2), 0.3, {})


def test_values_that_vary_are_linked_on() -> None:
    albedo, roughness, features = said(principled(Base_Color=texture((0.1, 0.5, 0.9)), Roughness=texture(0.7)))
    assert (albedo, roughness, features) == ((0.1, 0.5, 0.9), 0.7, {})


@pytest.mark.parametrize("metallic", [0.25, texture(0.25)])
@pytest.mark.parametrize("colour", [[0.6, 0.4, 0.2, 1.0], texture((0.6, 0.4, 0.2))])
def test_metal_has_no_albedo(metallic: float | Socket, colour: list[float] | Socket) -> None:
    albedo, _, features = said(principled(Metallic=metallic, Base_Color=colour))
    assert albedo == pytest.approx((0.45, 0.3, 0.15))
    assert features == {"metallic": 0.25}


@pytest.mark.parametrize(
    ("given", "feature", "weight"),
    [
        ({"Transmission_Weight": 0.5}, "transmission", 0.5),
        ({"Subsurface_Weight": 0.3}, "subsurface", 0.3),
        ({"Coat_Weight": 1.0}, "coat", 1.0),
        ({"Sheen_Weight": 0.2}, "sheen", 0.2),
        ({"Anisotropic": 0.4}, "anisotropic", 0.4),
        ({"Diffuse_Roughness": 0.6}, "rough_diffuse", 0.6),
        ({"Alpha": 0.75}, "transparent", 0.25),
        ({"IOR": 1.33}, "other_specular", 1.0),
        ({"Specular_IOR_Level": 0.0}, "other_specular", 1.0),
        ({"Specular_Tint": [1.0, 0.5, 0.5, 1.0]}, "other_specular", 1.0),
        ({"IOR": texture(1.5)}, "other_specular", 1.0),
        ({"Emission_Strength": 2.0}, "emissive", 1.0),
        ({"Normal": texture((0.5, 0.5, 1.0))}, "normal_map", 1.0),
    ],
)
def test_features_outside_the_brdf_get_weights(given: dict[str, Any], feature: str, weight: float) -> None:
    assert said(principled(**given))[2] == {feature: pytest.approx(weight)}


def test_a_diffuse_surface_has_no_lobe_and_a_mirror_no_albedo() -> None:
    assert said(shader("ShaderNodeBsdfDiffuse")) == ((0.1, 0.2, 0.3), 1.0, {"no_specular": 1.0})
    assert said(shader("ShaderNodeBsdfAnisotropic")) == ((0.0, 0.0, 0.0), 0.2, {"metallic": 1.0})


@pytest.mark.parametrize("share", [0.25, texture(0.25)])
def test_a_mixture_is_mixed_in_its_order(share: float | Socket) -> None:
    second = shader("ShaderNodeBsdfDiffuse")
    albedo, roughness, features = said(shader("ShaderNodeMixShader", Fac=share, Shader=principled(), Shader_001=second))
    assert albedo == pytest.approx((0.75 * 0.6 + 0.25 * 0.1, 0.75 * 0.4 + 0.25 * 0.2, 0.75 * 0.2 + 0.25 * 0.3))
    assert roughness == pytest.approx(0.75 * 0.3 + 0.25)
    assert features == {"no_specular": 0.25}


@pytest.mark.parametrize(("order", "transparent"), [((0, 1), 0.8), ((1, 0), 0.2)])
def test_a_cut_out_keeps_the_remaining_material(order: tuple[int, int], transparent: float) -> None:
    parts = [principled(), shader("ShaderNodeBsdfTransparent")]
    first, second = (parts[place] for place in order)
    albedo, roughness, features = said(shader("ShaderNodeMixShader", Fac=0.8, Shader=first, Shader_001=second))
    assert (albedo, roughness) == ((0.6, 0.4, 0.2), 0.3)
    assert features == {"transparent": pytest.approx(transparent)}


def test_a_sum_has_the_albedo_of_both_and_the_narrower_lobe() -> None:
    both = shader(
        "ShaderNodeAddShader", Shader=shader("ShaderNodeBsdfDiffuse"), Shader_001=shader("ShaderNodeBsdfAnisotropic")
    )
    albedo, roughness, features = said(both)
    assert (albedo, roughness) == ((0.1, 0.2, 0.3), 0.2)
    assert features == {"no_specular": 1.0, "metallic": 1.0}


def test_a_reroute_leads_on_and_an_empty_input_is_black() -> None:
    assert said(shader("NodeReroute", Input=principled()))[0] == (0.6, 0.4, 0.2)
    assert said(shader("ShaderNodeAddShader"))[0] == (0.0, 0.0, 0.0)


def test_untranslated_nodes_are_named() -> None:
    muted = principled()
    muted.mute = True
    with pytest.raises(NotUnderstood, match="ShaderNodeBsdfHair"):
        said(shader("ShaderNodeBsdfHair"))
    with pytest.raises(NotUnderstood, match="muted"):
        said(muted)


def test_outputs_are_given_numbers_or_links() -> None:
    tree = Tree()
    maths = Arithmetic(tree)
    maths.write("roughness", 0.5)
    maths.write("albedo", (0.1, 0.2, 0.3))
    maths.write("metallic", texture(0.4))
    nodes = {node.aov_name: node for node in tree.made}  # type: ignore[attr-defined]
    assert nodes["roughness"].inputs["Value"].default_value == 0.5
    assert tuple(nodes["albedo"].inputs["Color"].default_value) == (0.1, 0.2, 0.3, 1.0)
    assert tree.written()["metallic"] == 0.4


def test_a_number_that_comes_as_a_colour_is_written_as_a_number() -> None:
    """A mixture of colours may lead to an input for a number: Blender takes its mean there, and in an output alike."""
    tree = Tree()
    Arithmetic(tree).write("roughness", texture((0.25, 0.25, 0.25)))
    Arithmetic(tree).write("albedo", texture(0.5))
    roughness, albedo = ({each.name: each.is_linked for each in node.inputs} for node in tree.made)
    assert roughness == {"Color": False, "Value": True}
    assert albedo == {"Color": True, "Value": False}
