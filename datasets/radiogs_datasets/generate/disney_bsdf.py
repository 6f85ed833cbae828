"""The paper's simplified Disney BRDF (Eq. 4) as a Mitsuba plugin; no built-in one equals it.

    f = albedo / pi + D F V,   alpha = r^2,   k = (r + 1)^2 / 8,   F0 = 0.04
    V = 1 / (4 (n.wo (1 - k) + k) (n.wi (1 - k) + k)),   F = F0 + (1 - F0) 2^((-5.55473 c - 6.98316) c)

with c = wo.half. Sampled half from the cosine, half from the GGX distribution of half-vectors. One-sided. Mitsuba's
names are kept below: ``si.wi`` points to the viewer, ``wo`` to the light, both in the shading frame.
"""

# Mitsuba's types exist only once a variant is set, so annotations must not be evaluated here.
from __future__ import annotations

import drjit as dr
import mitsuba as mi

PLUGIN = "simplified_disney"
FRESNEL_NORMAL = 0.04


def register() -> None:
    """Make the plugin known to Mitsuba; a variant must be set."""

    class SimplifiedDisney(mi.BSDF):
        def __init__(self, props: mi.Properties) -> None:
            mi.BSDF.__init__(self, props)
            self.albedo = props.get_texture("albedo", 0.5)
            self.roughness = props.get_texture("roughness", 0.5)
            self.specular = props.get("specular", 1.0)
            front = mi.BSDFFlags.FrontSide
            self.m_components = [mi.BSDFFlags.DiffuseReflection | front, mi.BSDFFlags.GlossyReflection | front]
            self.m_flags = self.m_components[0] | self.m_components[1]

        def _value_and_density(
            self, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: mi.Bool | bool
        ) -> tuple[mi.Color3f, mi.Float]:
            """Value times the cosine, and the density of ``sample``."""
            view, light = mi.Frame3f.cos_theta(si.wi), mi.Frame3f.cos_theta(wo)
            active &= (view > 0) & (light > 0)
            roughness = self.roughness.eval_1(si, active)
            alpha2 = roughness**4
            half = dr.normalize(si.wi + wo)
            cosine = mi.Frame3f.cos_theta(half)
            spread = alpha2 * cosine * cosine + half.x * half.x + half.y * half.y
            distribution = alpha2 / (dr.pi * spread * spread)
            # Positive wherever both directions are above the surface; elsewhere nothing is kept.
            view_half = dr.select(active, dr.dot(si.wi, half), 1)
            fresnel = FRESNEL_NORMAL + (1 - FRESNEL_NORMAL) * dr.exp2((-5.55473 * view_half - 6.98316) * view_half)
            k = (roughness + 1) ** 2 / 8
            visibility = 0.25 / ((view * (1 - k) + k) * (light * (1 - k) + k))
            value = self.albedo.eval(si, active) / dr.pi + self.specular * distribution * fresnel * visibility
            density = 0.5 * light / dr.pi + 0.5 * distribution * cosine / (4 * view_half)
            return dr.select(active, value * light, 0), dr.select(active, density, 0)

        def sample(
            self,
            ctx: mi.BSDFContext,
            si: mi.SurfaceInteraction3f,
            sample1: mi.Float,
            sample2: mi.Point2f,
            active: mi.Bool | bool = True,
        ) -> tuple[mi.BSDFSample3f, mi.Color3f]:
            diffuse = mi.warp.square_to_cosine_hemisphere(sample2)
            alpha2 = self.roughness.eval_1(si, active) ** 4
            cosine = dr.sqrt((1 - sample2.x) / (1 + (alpha2 - 1) * sample2.x))
            sine = dr.safe_sqrt(1 - cosine * cosine)
            s, c = dr.sincos(2 * dr.pi * sample2.y)
            half = mi.Vector3f(sine * c, sine * s, cosine)
            glossy = 2 * dr.dot(si.wi, half) * half - si.wi
            bs = mi.BSDFSample3f()
            bs.wo = dr.select(sample1 < 0.5, diffuse, glossy)
            value, bs.pdf = self._value_and_density(si, bs.wo, active)
            bs.eta = 1.0
            bs.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
            bs.sampled_component = mi.UInt32(0)
            valid = active & (bs.pdf > 0)
            return bs, dr.select(valid, value / dr.select(valid, bs.pdf, 1), 0)

        def eval(
            self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: mi.Bool | bool = True
        ) -> mi.Color3f:
            return self._value_and_density(si, wo, active)[0]

        def pdf(
            self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: mi.Bool | bool = True
        ) -> mi.Float:
            return self._value_and_density(si, wo, active)[1]

        def eval_pdf(
            self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: mi.Bool | bool = True
        ) -> tuple[mi.Color3f, mi.Float]:
            return self._value_and_density(si, wo, active)

        def eval_attribute_3(self, name: str, si: mi.SurfaceInteraction3f, active: mi.Bool | bool = True) -> mi.Color3f:
            return self.albedo.eval(si, active)

        def eval_attribute_1(self, name: str, si: mi.SurfaceInteraction3f, active: mi.Bool | bool = True) -> mi.Float:
            return self.roughness.eval_1(si, active)

        def traverse(self, callback: mi.TraversalCallback) -> None:
            callback.put("albedo", self.albedo, mi.ParamFlags.Differentiable)
            callback.put("roughness", self.roughness, mi.ParamFlags.Differentiable)

    mi.register_bsdf(PLUGIN, SimplifiedDisney)
