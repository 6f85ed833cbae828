"""The shading kernels: one thread a surfel, a loop over its views and samples, forward and backward.

With h the half-vector, D, F and V the terms of ``brdf`` and s = D F V (the specular lobe), each sample adds

    weight (n.wi) { albedo / pi, s } x { visibility Env(wi), L_ind }

to the four sums. The backward pass evaluates the same terms again and keeps nothing in between.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..brdf import FRESNEL_NORMAL
from .runtime import scalar_type, start_warp

PI = 3.141592653589793


@cache
def shade_kernels(dtype: torch.dtype) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type."""
    start_warp()
    scalar = scalar_type(dtype)
    vector = wp.types.vector(3, scalar)
    one, zero, half_, pi = (wp.constant(scalar(value)) for value in (1.0, 0.0, 0.5, PI))
    base = wp.constant(scalar(FRESNEL_NORMAL))
    slope, curve = wp.constant(scalar(-6.98316)), wp.constant(scalar(-5.55473))

    @wp.struct
    class Inputs:
        normal: wp.array(dtype=vector)
        albedo: wp.array(dtype=vector)
        roughness: wp.array(dtype=scalar)
        outgoing: wp.array2d(dtype=vector)
        direction: wp.array2d(dtype=vector)
        weight: wp.array2d(dtype=scalar)
        visibility: wp.array2d(dtype=scalar)
        indirect: wp.array2d(dtype=vector)
        environment: wp.array2d(dtype=vector)

    @wp.struct
    class Lookup:
        upper: wp.int32
        lower: wp.int32
        first: wp.int32
        second: wp.int32
        down: scalar
        right: scalar

    @wp.struct
    class Lobe:
        value: scalar
        distribution: scalar
        fresnel: scalar
        visibility: scalar
        spread: scalar
        half: vector
        half_cosine: scalar
        view_term: scalar
        light_term: scalar

    @wp.func
    def locate(direction: vector, height: wp.int32, width: wp.int32):
        column = (half_ - wp.atan2(direction[1], direction[0]) / (scalar(2.0) * pi)) * scalar(width) - half_
        flat = wp.sqrt(direction[0] * direction[0] + direction[1] * direction[1])
        row = wp.clamp(wp.atan2(flat, direction[2]) / pi * scalar(height) - half_, zero, scalar(height - 1))
        left = wp.floor(column)
        top = wp.floor(row)
        found = Lookup()
        found.upper = wp.int32(top)
        found.lower = wp.min(found.upper + 1, height - 1)
        found.first = (wp.int32(left) + width) % width
        found.second = (found.first + 1) % width
        found.down = row - top
        found.right = column - left
        return found

    @wp.func
    def fetch(environment: wp.array2d(dtype=vector), at: Lookup):
        above = (one - at.right) * environment[at.upper, at.first] + at.right * environment[at.upper, at.second]
        below = (one - at.right) * environment[at.lower, at.first] + at.right * environment[at.lower, at.second]
        return (one - at.down) * above + at.down * below

    @wp.func
    def lobe_of(
        normal: vector,
        wo: vector,
        wi: vector,
        view_cosine: scalar,
        light_cosine: scalar,
        alpha_squared: scalar,
        k: scalar,
    ):
        lobe = Lobe()
        lobe.half = wp.normalize(wo + wi)
        lobe.half_cosine = wp.dot(normal, lobe.half)
        sine = wp.cross(normal, lobe.half)
        lobe.spread = alpha_squared * lobe.half_cosine * lobe.half_cosine + wp.dot(sine, sine)
        lobe.distribution = alpha_squared / (pi * lobe.spread * lobe.spread)
        view_half = wp.dot(wo, lobe.half)
        lobe.fresnel = base + (one - base) * wp.pow(scalar(2.0), (curve * view_half + slope) * view_half)
        lobe.view_term = view_cosine * (one - k) + k
        lobe.light_term = light_cosine * (one - k) + k
        lobe.visibility = scalar(0.25) / (lobe.view_term * lobe.light_term)
        lobe.value = lobe.distribution * lobe.fresnel * lobe.visibility
        return lobe

    @wp.kernel(enable_backward=False, module="unique")
    def forward(first: wp.int32, given: Inputs, out: wp.array3d(dtype=vector)):
        surfel = first + wp.tid()
        normal = given.normal[surfel]
        roughness = given.roughness[surfel]
        alpha_squared = roughness * roughness * roughness * roughness
        k = (roughness + one) * (roughness + one) / scalar(8.0)
        height = given.environment.shape[0]
        width = given.environment.shape[1]
        for view in range(given.outgoing.shape[1]):
            wo = given.outgoing[surfel, view]
            view_cosine = wp.dot(normal, wo)
            diffuse_direct = vector()
            diffuse_indirect = vector()
            specular_direct = vector()
            specular_indirect = vector()
            if view_cosine > zero:
                for sample in range(given.direction.shape[1]):
                    wi = given.direction[surfel, sample]
                    light_cosine = wp.dot(normal, wi)
                    if light_cosine > zero:
                        weight = given.weight[surfel, sample] * light_cosine
                        at = locate(wi, height, width)
                        direct = weight * given.visibility[surfel, sample] * fetch(given.environment, at)
                        indirect = weight * given.indirect[surfel, sample]
                        lobe = lobe_of(normal, wo, wi, view_cosine, light_cosine, alpha_squared, k)
                        diffuse_direct += direct
                        diffuse_indirect += indirect
                        specular_direct += lobe.value * direct
                        specular_indirect += lobe.value * indirect
            albedo = given.albedo[surfel] / pi
            out[surfel, view, 0] = wp.cw_mul(albedo, diffuse_direct)
            out[surfel, view, 1] = wp.cw_mul(albedo, diffuse_indirect)
            out[surfel, view, 2] = specular_direct
            out[surfel, view, 3] = specular_indirect

    @wp.kernel(enable_backward=False, module="unique")
    def backward(
        first: wp.int32,
        given: Inputs,
        grad_out: wp.array3d(dtype=vector),
        wants_incident: wp.int32,
        wants_environment: wp.int32,
        grad_normal: wp.array(dtype=vector),
        grad_albedo: wp.array(dtype=vector),
        grad_roughness: wp.array(dtype=scalar),
        grad_visibility: wp.array2d(dtype=scalar),
        grad_indirect: wp.array2d(dtype=vector),
        grad_environment: wp.array2d(dtype=vector),
    ):
        surfel = first + wp.tid()
        normal = given.normal[surfel]
        albedo = given.albedo[surfel] / pi
        roughness = given.roughness[surfel]
        alpha_squared = roughness * roughness * roughness * roughness
        k = (roughness + one) * (roughness + one) / scalar(8.0)
        height = given.environment.shape[0]
        width = given.environment.shape[1]
        pull_normal = vector()
        pull_albedo = vector()
        pull_alpha_squared = zero
        pull_k = zero
        for view in range(given.outgoing.shape[1]):
            wo = given.outgoing[surfel, view]
            view_cosine = wp.dot(normal, wo)
            if view_cosine > zero:
                pull_diffuse_direct = grad_out[surfel, view, 0]
                pull_diffuse_indirect = grad_out[surfel, view, 1]
                pull_specular_direct = grad_out[surfel, view, 2]
                pull_specular_indirect = grad_out[surfel, view, 3]
                base_direct = wp.cw_mul(albedo, pull_diffuse_direct)
                base_indirect = wp.cw_mul(albedo, pull_diffuse_indirect)
                pull_view_cosine = zero
                for sample in range(given.direction.shape[1]):
                    wi = given.direction[surfel, sample]
                    light_cosine = wp.dot(normal, wi)
                    if light_cosine > zero:
                        solid = given.weight[surfel, sample]
                        weight = solid * light_cosine
                        seen = given.visibility[surfel, sample]
                        at = locate(wi, height, width)
                        environment = fetch(given.environment, at)
                        direct = seen * environment
                        indirect = given.indirect[surfel, sample]
                        lobe = lobe_of(normal, wo, wi, view_cosine, light_cosine, alpha_squared, k)
                        pull_direct = base_direct + lobe.value * pull_specular_direct
                        pull_indirect = base_indirect + lobe.value * pull_specular_indirect
                        pull_albedo += weight * (
                            wp.cw_mul(pull_diffuse_direct, direct) + wp.cw_mul(pull_diffuse_indirect, indirect)
                        )
                        if wants_incident != 0:
                            grad_visibility[surfel, sample] = grad_visibility[surfel, sample] + weight * wp.dot(
                                pull_direct, environment
                            )
                            grad_indirect[surfel, sample] = grad_indirect[surfel, sample] + weight * pull_indirect
                        if wants_environment != 0:
                            flow = (weight * seen) * pull_direct
                            upper = (one - at.down) * flow
                            lower = at.down * flow
                            wp.atomic_add(grad_environment, at.upper, at.first, (one - at.right) * upper)
                            wp.atomic_add(grad_environment, at.upper, at.second, at.right * upper)
                            wp.atomic_add(grad_environment, at.lower, at.first, (one - at.right) * lower)
                            wp.atomic_add(grad_environment, at.lower, at.second, at.right * lower)
                        arriving = wp.dot(pull_direct, direct) + wp.dot(pull_indirect, indirect)
                        pull_lobe = weight * (
                            wp.dot(pull_specular_direct, direct) + wp.dot(pull_specular_indirect, indirect)
                        )
                        through = pull_lobe * lobe.value
                        pull_view_cosine -= through * (one - k) / lobe.view_term
                        pull_light_cosine = solid * arriving - through * (one - k) / lobe.light_term
                        pull_k -= through * (
                            (one - view_cosine) / lobe.view_term + (one - light_cosine) / lobe.light_term
                        )
                        cosine = lobe.half_cosine
                        pull_alpha_squared += through * (
                            one / alpha_squared - scalar(2.0) * cosine * cosine / lobe.spread
                        )
                        widening = scalar(-4.0) * through / lobe.spread
                        pull_normal += pull_light_cosine * wi + widening * (
                            normal + ((alpha_squared - one) * cosine) * lobe.half
                        )
                pull_normal += pull_view_cosine * wo
        grad_normal[surfel] = pull_normal
        grad_albedo[surfel] = pull_albedo / pi
        grad_roughness[surfel] = pull_alpha_squared * scalar(4.0) * roughness * roughness * roughness + pull_k * (
            roughness + one
        ) / scalar(4.0)

    return SimpleNamespace(Inputs=Inputs, forward=forward, backward=backward, vector=vector)
