"""The blending kernels of the rasterizer: one thread a pixel, front to back, forward and backward.

A surfel enters as a homography from the pixel ray d (camera axes, unit depth) to its plane: with
n' = normal, m_u = (axis_u . (o - c)) n' + (n' . (c - o)) axis_u, all in camera axes,

    t = offset / (n' . d),   u = (m_u . d) / (n' . d),   v = (m_v . d) / (n' . d),

so a hit costs three dot products, and the chain rule to centre, axes and normal is left to PyTorch.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from .geometry import MAX_ALPHA, RASTER_TRANSMITTANCE_STOP
from .runtime import scalar_type, start_warp

TILE = 4
"""Pixels along a tile's edge: on one core 4 measured faster than 8 and 16 (fewer misses)."""

RECORD = 12
"""Scalars of a surfel's record: n' (3), m_u (3), m_v (3), offset, opacity, squared support radius."""

PIXEL_SUMS = 5
"""Scalars kept per pixel: sum w, sum w z, distortion, sum w m, sum w m^2, with m = z / depth_unit."""


@cache
def blend_kernels(dtype: torch.dtype, channels: int) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type and a number of feature channels."""
    start_warp()
    scalar = scalar_type(dtype)
    vector = wp.types.vector(3, scalar)
    feature = wp.types.vector(channels, scalar)
    record = wp.types.vector(RECORD, scalar)
    ceiling = wp.constant(scalar(MAX_ALPHA))
    stop = wp.constant(scalar(RASTER_TRANSMITTANCE_STOP))

    @wp.struct
    class Image:
        width: wp.int32
        height: wp.int32
        tiles_across: wp.int32
        fx: scalar
        fy: scalar
        cx: scalar
        cy: scalar
        depth_unit: scalar

    @wp.struct
    class Splats:
        starts: wp.array(dtype=wp.int32)
        members: wp.array(dtype=wp.int32)
        records: wp.array(dtype=record)
        features: wp.array(dtype=feature)

    @wp.func
    def pixel_of(image: Image, index: wp.int32):
        tile = index // wp.static(TILE * TILE)
        place = index - tile * wp.static(TILE * TILE)
        column = (tile % image.tiles_across) * wp.static(TILE) + place % wp.static(TILE)
        row = (tile // image.tiles_across) * wp.static(TILE) + place // wp.static(TILE)
        return wp.vec3i(tile, column, row)

    @wp.func
    def ray_of(image: Image, column: wp.int32, row: wp.int32):
        return vector(
            (scalar(column) + scalar(0.5) - image.cx) / image.fx,
            (scalar(row) + scalar(0.5) - image.cy) / image.fy,
            scalar(1.0),
        )

    @wp.func
    def along(splat: record, start: wp.int32, ray: vector):
        return splat[start] * ray[0] + splat[start + 1] * ray[1] + splat[start + 2] * ray[2]

    @wp.kernel(enable_backward=False, module="unique")
    def forward(
        first: wp.int32,
        image: Image,
        splats: Splats,
        out_features: wp.array(dtype=feature),
        out_sums: wp.array2d(dtype=scalar),
        out_end: wp.array(dtype=wp.int32),
        out_blended: wp.array(dtype=wp.int32),
    ):
        place = pixel_of(image, first + wp.tid())
        if place[1] >= image.width or place[2] >= image.height:
            return
        ray = ray_of(image, place[1], place[2])
        left = scalar(1.0)
        total = feature()
        weight_sum = scalar(0.0)
        depth_sum = scalar(0.0)
        distortion = scalar(0.0)
        first_moment = scalar(0.0)
        second_moment = scalar(0.0)
        blended = wp.int32(0)
        end = splats.starts[place[0] + 1]
        for entry in range(splats.starts[place[0]], splats.starts[place[0] + 1]):
            member = splats.members[entry]
            splat = splats.records[member]
            slope = along(splat, 0, ray)
            if slope < scalar(0.0):
                inverse = scalar(1.0) / slope
                depth = splat[9] * inverse
                if depth > scalar(0.0):
                    u = along(splat, 3, ray) * inverse
                    v = along(splat, 6, ray) * inverse
                    square = u * u + v * v
                    if square <= splat[11]:
                        alpha = wp.min(splat[10] * wp.exp(scalar(-0.5) * square), ceiling)
                        rest = left * (scalar(1.0) - alpha)
                        if rest < stop:
                            end = entry
                            break
                        weight = alpha * left
                        moment = depth / image.depth_unit
                        total += weight * splats.features[member]
                        distortion += weight * (
                            moment * moment * weight_sum + second_moment - scalar(2.0) * moment * first_moment
                        )
                        weight_sum += weight
                        depth_sum += weight * depth
                        first_moment += weight * moment
                        second_moment += weight * moment * moment
                        left = rest
                        blended += 1
        pixel = place[2] * image.width + place[1]
        out_features[pixel] = total
        out_sums[pixel, 0] = weight_sum
        out_sums[pixel, 1] = depth_sum
        out_sums[pixel, 2] = distortion
        out_sums[pixel, 3] = first_moment
        out_sums[pixel, 4] = second_moment
        out_end[pixel] = end
        out_blended[pixel] = blended

    @wp.kernel(enable_backward=False, module="unique")
    def backward(
        first: wp.int32,
        image: Image,
        splats: Splats,
        features_out: wp.array(dtype=feature),
        sums: wp.array2d(dtype=scalar),
        ends: wp.array(dtype=wp.int32),
        grad_features_out: wp.array(dtype=feature),
        grad_sums: wp.array2d(dtype=scalar),
        grad_records: wp.array(dtype=record),
        grad_features: wp.array(dtype=feature),
    ):
        place = pixel_of(image, first + wp.tid())
        if place[1] >= image.width or place[2] >= image.height:
            return
        pixel = place[2] * image.width + place[1]
        ray = ray_of(image, place[1], place[2])
        pull = grad_features_out[pixel]
        pull_weight = grad_sums[pixel, 0]
        pull_depth = grad_sums[pixel, 1]
        pull_distortion = grad_sums[pixel, 2]
        weight_sum = sums[pixel, 0]
        first_moment = sums[pixel, 3]
        second_moment = sums[pixel, 4]
        # sum_i w_i dL/dw_i over the whole pixel; what is behind a hit is this minus what is in front of it.
        behind = (
            wp.dot(pull, features_out[pixel])
            + pull_weight * weight_sum
            + pull_depth * sums[pixel, 1]
            + scalar(2.0) * pull_distortion * sums[pixel, 2]
        )
        left = scalar(1.0)
        for entry in range(splats.starts[place[0]], ends[pixel]):
            member = splats.members[entry]
            splat = splats.records[member]
            slope = along(splat, 0, ray)
            if slope < scalar(0.0):
                inverse = scalar(1.0) / slope
                depth = splat[9] * inverse
                if depth > scalar(0.0):
                    u = along(splat, 3, ray) * inverse
                    v = along(splat, 6, ray) * inverse
                    square = u * u + v * v
                    if square <= splat[11]:
                        bell = wp.exp(scalar(-0.5) * square)
                        full = splat[10] * bell
                        alpha = wp.min(full, ceiling)
                        weight = alpha * left
                        moment = depth / image.depth_unit
                        slope_weight = (
                            wp.dot(pull, splats.features[member])
                            + pull_weight
                            + pull_depth * depth
                            + pull_distortion
                            * (moment * moment * weight_sum + second_moment - scalar(2.0) * moment * first_moment)
                        )
                        behind -= weight * slope_weight
                        grad_alpha = left * slope_weight - behind / (scalar(1.0) - alpha)
                        wp.atomic_add(grad_features, member, weight * pull)
                        grad_depth = weight * (
                            pull_depth
                            + scalar(2.0) * pull_distortion * (moment * weight_sum - first_moment) / image.depth_unit
                        )
                        grad_bell = scalar(0.0)
                        if full < ceiling:
                            grad_bell = grad_alpha * bell
                        grad_u = -grad_bell * splat[10] * u * inverse
                        grad_v = -grad_bell * splat[10] * v * inverse
                        grad_t = grad_depth * inverse
                        grad_slope = -(grad_u * u + grad_v * v + grad_t * depth)
                        grad = record()
                        for axis in range(3):
                            grad[axis] = grad_slope * ray[axis]
                            grad[axis + 3] = grad_u * ray[axis]
                            grad[axis + 6] = grad_v * ray[axis]
                        grad[9] = grad_t
                        grad[10] = grad_bell
                        wp.atomic_add(grad_records, member, grad)
                        left = left * (scalar(1.0) - alpha)

    return SimpleNamespace(
        Image=Image, Splats=Splats, forward=forward, backward=backward, record=record, feature=feature
    )
