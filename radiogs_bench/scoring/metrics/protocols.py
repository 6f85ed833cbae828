"""The named protocols; docs/protocols.md cites the public code for each convention."""

from collections.abc import Mapping
from dataclasses import replace

from radiogs_core.errors import unknown

from .conventions import Albedo, Bits, DepthOffset, Indirect, Lpips, Normal, Picture, Psnr, Roughness, Ssim
from .protocol import Protocol
from .stanford_orb import STANFORD_ORB

BYTES: Bits = "8 bit rounded"
CUT_BYTES: Bits = "8 bit truncated"

DEFAULT = Protocol("default", albedo=Albedo(difference="CIEDE2000"), depth_offset=DepthOffset())

MASKED = Picture(prediction="times true coverage")
MASKED_IN_DISPLAY = Picture(prediction="display times true coverage", target="composited in display")
"""Both sides times the true coverage as display values: R3DG encodes albedo first and multiplies then."""
MASKED_TWICE = Picture(prediction="times true coverage", target="times coverage again", clipped=False)
"""Both sides times the true coverage; the truth is already on black, so its soft edges are multiplied twice."""

SPLATTING = Protocol(
    "splatting",
    psnr=Psnr(channels="mean of channels"),
    ssim=Ssim(padding="zero"),
    lpips=(Lpips("vgg", "[0, 1]"),),
    normal=Normal(region="image"),
    roughness=None,
    indirect=None,
)
"""Conventions shared by codes derived from 3D Gaussian splatting; not a named protocol."""

UNNORMALISED = Normal(region="image", lengths="own coverage")
"""Normals as 2DGS's renderer gives them, whose coverage counts twice where they are blended by it again."""

SYNTHETIC4RELIGHT = Albedo(
    pixels="covered, any truth",
    fitted_target="composited in display",
    picture=replace(MASKED_TWICE, target="composited in display"),
)
"""It stores albedo as display values: the truth is multiplied by its coverage, and decoded then."""

RADIOGS = replace(
    SPLATTING,
    name="radiogs",
    version=2,
    nvs=Picture(target_bits=CUT_BYTES),
    relight=MASKED,
    normal=UNNORMALISED,
    albedo=Albedo(pixels="covered", picture=MASKED_TWICE),
    layouts={"synthetic4relight": SYNTHETIC4RELIGHT},
    roughness=Roughness("image", "times coverage again"),
    indirect=Indirect("incident", Picture(prediction="times true coverage", prediction_bits=BYTES)),
)

IRGS_AGAIN = replace(MASKED_TWICE, target="composited in display, times coverage again")
"""IRGS's script for Synthetic4Relight multiplies the decoded truth by the mask once more, which RadioGS's does not."""

IRGS = replace(
    RADIOGS,
    name="irgs",
    version=3,
    layouts={"synthetic4relight": replace(SYNTHETIC4RELIGHT, picture=IRGS_AGAIN)},
    indirect=None,
)

R3DG = replace(
    SPLATTING,
    name="r3dg",
    version=2,
    relight=MASKED,
    normal=None,
    albedo=Albedo(pixels="covered, any truth", psnr_space="srgb", structure_space="srgb", picture=MASKED_IN_DISPLAY),
    roughness=Roughness("image"),
)

SVG_IR = replace(
    SPLATTING,
    name="svg-ir",
    version=2,
    relight=MASKED,
    normal=Normal(region="image", blended_by="true coverage", lengths="own coverage"),
    albedo=Albedo(
        fitted_to="first view",
        fitted_target="straight",
        pixels="predicted",
        largest=10.0,
        psnr_space="srgb",
        structure_space="srgb",
    ),
)

GS_IR = replace(
    SPLATTING,
    name="gs-ir",
    version=2,
    relight=Picture(prediction="times true coverage", target="straight", prediction_bits=BYTES),
    normal=Normal(region="image", prediction_bits=BYTES),
    albedo=Albedo(
        pixels="covered, any truth",
        fitted_target="straight",
        scaled="covered",
        picture=Picture(target="straight", clipped=False, prediction_bits=BYTES),
        relights=False,
    ),
)

GI_GS = replace(GS_IR, name="gi-gs", roughness=Roughness("mask"))

TENSOIR = Protocol(
    "tensoir",
    version=2,
    nvs=Picture(background="white"),
    relight=Picture(background="white", prediction="solid"),
    psnr=Psnr(albedo_views="pooled"),
    ssim=Ssim(bounded=True),
    lpips=(Lpips("vgg"), Lpips("alex")),
    normal=Normal(region="image"),
    albedo=Albedo(
        fitted_to="20 views",
        pixels="covered, any truth",
        psnr_space="gamma 2.2",
        picture=Picture(background="white", prediction="background outside truth"),
    ),
    roughness=None,
    indirect=None,
)

PROTOCOLS: Mapping[str, Protocol] = {
    rules.name: rules for rules in (DEFAULT, RADIOGS, IRGS, R3DG, GS_IR, GI_GS, SVG_IR, TENSOIR, STANFORD_ORB)
}


def protocol(name: str) -> Protocol:
    """The protocol of that name. Raises UsageError for an unknown one."""
    if name not in PROTOCOLS:
        raise unknown("metric protocol", name, PROTOCOLS)
    return PROTOCOLS[name]
