"""The paper's simplified Disney BRDF (Eq. 4) as a Mitsuba plugin; no built-in one equals it.

    f = albedo / pi + D F V,   alpha = r^2,   k = (r + 1)^2 / 8,   F0 = 0.04
    V = 1 / (4 (n.wo (1 - k) + k) (n.wi (1 - k) + k)),   F = F0 + (1 - F0) 2^((-5.55473 c - 6.98316) c)

Sampled half from the cosine, half from the GGX distribution of half-vectors. One-sided.
"""

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
            front = mi.BSDFFlags.FrontSide
            self.m_components = [mi.BSDFFlags.DiffuseReflection | front, mi.BSDFFlags.GlossyReflection | front]
            self.m_flags = self.m_components[0] | self.m_components[1]

        def _terms(self, si, wo, active):
            """Value times the cosine, and the density of ``sample``."""
            view, light = mi.Frame3f.cos_theta(si.wi), mi.Frame3f.cos_theta(wo)
            active &= (view > 0) & (light > 0)
            roughness = self.roughness.eval_1(si, active)
            alpha2 = roughness**4
            half = dr.normalize(si.wi + wo)
            cosine = mi.Frame3f.cos_theta(half)
            spread = alpha2 * cosine * cosine + half.x * half.x + half.y * half.y
            distribution = alpha2 / (dr.pi * spread * spread)
            view_half = dr.dot(si.wi, half)
            fresnel = FRESNEL_NORMAL + (1 - FRESNEL_NORMAL) * dr.exp2((-5.55473 * view_half - 6.98316) * view_half)
            k = (roughness + 1) ** 2 / 8
            visibility = 0.25 / ((view * (1 - k) + k) * (light * (1 - k) + k))
            value = self.albedo.eval(si, active) / dr.pi + distribution * fresnel * visibility
            pdf = 0.5 * light / dr.pi + 0.5 * distribution * cosine / (4 * dr.maximum(view_half, 1e-6))
            return dr.select(active, value * light, 0), dr.select(active, pdf, 0)

        def sample(self, ctx, si, sample1, sample2, active=True):
            diffuse = mi.warp.square_to_cosine_hemisphere(sample2)
            alpha2 = self.roughness.eval_1(si, active) ** 4
            cosine = dr.sqrt((1 - sample2.x) / (1 + (alpha2 - 1) * sample2.x))
            sine = dr.safe_sqrt(1 - cosine * cosine)
            s, c = dr.sincos(2 * dr.pi * sample2.y)
            half = mi.Vector3f(sine * c, sine * s, cosine)
            glossy = 2 * dr.dot(si.wi, half) * half - si.wi
            bs = mi.BSDFSample3f()
            bs.wo = dr.select(sample1 < 0.5, diffuse, glossy)
            value, bs.pdf = self._terms(si, bs.wo, active)
            bs.eta = 1.0
            bs.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
            bs.sampled_component = mi.UInt32(0)
            valid = active & (bs.pdf > 0)
            return bs, dr.select(valid, value / dr.select(valid, bs.pdf, 1), 0)

        def eval(self, ctx, si, wo, active=True):
            return self._terms(si, wo, active)[0]

        def pdf(self, ctx, si, wo, active=True):
            return self._terms(si, wo, active)[1]

        def eval_pdf(self, ctx, si, wo, active=True):
            return self._terms(si, wo, active)

        def traverse(self, callback):
            callback.put("albedo", self.albedo, mi.ParamFlags.Differentiable)
            callback.put("roughness", self.roughness, mi.ParamFlags.Differentiable)

    mi.register_bsdf(PLUGIN, SimplifiedDisney)
