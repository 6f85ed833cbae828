"""The hard cases: description, judge, tolerance with its reason, and tests of each.

``eps`` is float32's 1.19e-7. "ref64" is plain float64 on the inputs as they were rounded to float32 (``ref64``,
``reference``). Tests in this folder carry ``@pytest.mark.case(number)``; tests that stand elsewhere are named here.
``shortfall`` states what does not hold, by how much, and why; its test is a strict expected failure.
"""

from dataclasses import dataclass
from typing import Literal

Group = Literal["primitives", "camera and scene", "shading and light transport", "autograd and precision", "metrics"]


@dataclass(frozen=True)
class Case:
    """One row of the catalogue; ``modules`` are files of this folder, ``elsewhere`` tests as file::name."""

    number: int
    name: str
    group: Group
    construction: str
    reference: str
    tolerance: str
    modules: tuple[str, ...] = ()
    elsewhere: tuple[str, ...] = ()
    shortfall: str = ""


PRIMITIVES = "test_primitives.py"
CAMERA = "test_camera.py"
INVARIANCE = "test_invariance.py"
BRDF = "test_brdf_and_furnaces.py"
LIGHT = "test_light.py"
PRECISION = "test_autograd_and_precision.py"
HAZARDS = "test_hazards.py"
POISON = "test_poison.py"

CASES = (
    Case(
        1, "zero quaternion", "primitives", "q = 0, and |q| in {1e-38, 1e-20, 1e-8}",
        "the scene without it; Rodrigues' formula in float64",
        "bit for bit; 4 eps (two roundings a product of unit entries)", (PRIMITIVES,),
    ),
    Case(
        2, "un-normalised quaternion", "primitives", "q times {1e-6, 1, 1e6}", "invariance",
        "8 eps (an eps an entry, doubled by the product of two)", (),
        ("method/core/kernels/test_footprint.py::test_the_length_of_a_quaternion_does_not_matter",),
    ),
    Case(
        3, "zero scale", "primitives", "one axis and both, also where exp underflows", "the scene without it",
        "bit for bit: it is culled", (PRIMITIVES,),
    ),
    Case(
        4, "needle and pancake", "primitives", "aspect 1e2 to 1e6, drawn and traced", "ref64",
        "drawn: 1e-4, the pixel's footprint bounds the condition number; traced: o e^(-1/2) 8 eps |p - o| / s",
        (PRIMITIVES,),
    ),
    Case(
        5, "huge surfel", "primitives", "log-scale 20 over the whole camera", "opacity times colour, constant",
        "1e-5 and finite gradients", (PRIMITIVES,),
    ),
    Case(
        6, "opacity at its limits", "primitives", "0, 1e-8, 1/255 and 0.01 -+ an ulp, 1 - eps, 1; logits of +-40",
        "ref64; exactly nothing below 1/255", "1e-6 drawn (8 eps), 2e-6 traced (a sum of two hits)",
        (PRIMITIVES,),
    ),
    Case(
        7, "stack of opaque surfels", "primitives", "3, 10, 100 surfels with o = 1 on one ray",
        "gradients of the dense reference in float64", "1e-3 of the largest; each below 1e2 / (1 - MAX_ALPHA) = 1e4",
        (PRIMITIVES,),
    ),
    Case(
        8, "underflow of transmittance", "primitives",
        "30 000 layers: alpha in [0, 0.001], in [1/250, 1/200] and in [1/250, 0.5], without a stop",
        "sum of logarithms in float64", "1e-5 relative or 1e-7 absolute; 0 exactly below the alpha threshold",
        (PRIMITIVES,),
    ),
    Case(
        9, "edge-on surfel", "primitives", "n.d from 1e-1 to 1e-8, and 0", "ref64",
        "16 eps / |n.d| (two products and a quotient, amplified by the quotient); gradients 64 eps / |n.d|; 0 at 0",
        (PRIMITIVES,),
    ),
    Case(
        10, "back-face threshold", "primitives", "normals within 0.02 of edge-on, world times 1e-3 to 1e3",
        "the image at scale 1", "at most 0.1 % of the pixels on the other side", (PRIMITIVES, INVARIANCE),
    ),
    Case(
        11, "coincident surfels", "primitives", "17, 33, 64 at one depth: more than a buffer", "ref64, ties by number",
        "1e-6, and to permutation of equals 1e-6", (PRIMITIVES, HAZARDS),
        ("method/core/kernels/test_trace.py::test_exactly_coincident_surfels_are_neither_lost_nor_swapped",),
    ),
    Case(
        12, "nearly equal depth", "primitives", "1, 2, 4 ulps apart, in either order", "ref64 sorted by rounded depth",
        "1e-6 drawn, 2e-6 traced", (PRIMITIVES,),
    ),
    Case(
        13, "poison", "primitives", "22 values in every slot of surfels, camera and light, 5 060 draws",
        "named, left out, never read, or the float64 image", "bit for bit; 1e-4 where the value is one", (POISON,),
    ),
    Case(
        14, "extreme but valid", "primitives", "log-scale -30 to 40, harmonics 1e3, colours 1e4", "ref64",
        "1e-5 of the largest value; surfels thinner than a pixel's 1/255 rightly add nothing", (PRIMITIVES,),
    ),
    Case(
        15, "behind the camera", "camera and scene", "a surfel through the camera's plane; one wholly behind",
        "ref64, t > 0 only", "1e-6; bit for bit", (),
        ("method/core/kernels/test_rasterize.py::test_surfels_that_cross_the_cameras_plane_are_neither_lost_nor_ghosts",),
    ),
    Case(
        16, "near plane", "camera and scene", "centre within 1e-6 of the camera's plane (there is no other), tilted",
        "ref64 with a depth test per pixel", "1e-4 but for at most 0.1 % of the pixels", (CAMERA,),
    ),
    Case(
        17, "surfel at the camera's centre", "camera and scene", "p = c, and 1e-7 before and behind it",
        "the scene without it; ref64", "bit for bit with zero gradient; 1e-6", (CAMERA,),
    ),
    Case(
        18, "large translation", "camera and scene", "everything + {1e2, 1e4, 1e6}; 100 000 surfels + 1e4 (slow)",
        "the float64 pipeline on the rounded inputs; quantisation apart",
        "1e-4 (measured 1.3e-6; 1.5e-5 for 100 000)", (INVARIANCE,),
    ),
    Case(
        19, "scene's scale", "camera and scene", "times {1e-3, 1e3}, 2^-10, 2^10; 100 000 surfels (slow)",
        "the image at scale 1, depth times the scale",
        "1e-4 (measured 1.5e-6), float64 1e-12, powers of two bit for bit; of 100 000 surfels one pixel in 4096 meets a"
        " hit at the alpha threshold in one precision only and may be off by 1/255", (INVARIANCE,),
    ),
    Case(
        20, "rigid motion", "camera and scene", "random SE(3) of camera, surfels, harmonics and rays; light by texels",
        "invariance", "1e-9 in float64, 1e-4 in float32", (INVARIANCE,),
    ),
    Case(
        21, "empty scene", "camera and scene", "no surfel, all behind, one", "background exactly, zero gradients",
        "bit for bit", (CAMERA,),
        ("method/core/kernels/test_rasterize.py::test_an_empty_scene_is_the_background_and_takes_gradients",),
    ),
    Case(
        22, "image shapes", "camera and scene", "1x1, 1x17, 17x1, 15x33, 4096x1",
        "the dense image in float64", "1e-11", (),
        ("method/core/kernels/test_rasterize.py::test_any_image_shape_is_covered",),
    ),
    Case(
        23, "index width", "camera and scene", "6.25e11 pairs of surfel and tile; 2^31 hits", "64-bit arithmetic",
        "exact, then a named error", (CAMERA,),
    ),
    Case(
        24, "self-intersection", "camera and scene", "closed shell and plane at scales 1e-3 to 1e3, offset to 1e6",
        "visibility 0 inside the shell, 1 on the plane", "leak below 1e-3; no false occlusion", (CAMERA,),
        ("method/core/kernels/test_trace.py::test_a_closed_room_sees_no_light_and_a_convex_body_sees_all",),
    ),
    Case(
        25, "GGX at roughness 0", "shading and light transport", "r in {1e-3, .02, .05, .1, 1}, 1e-6 to 1 rad off",
        "closed form of the angle in float64; dense shading", "1e-5 relative and of D r^4 (measured 7e-7; kernel 4e-6)",
        (BRDF,), ("method/core/kernels/test_shade.py::test_sharp_lobes_keep_their_digits_in_float32",),
    ),
    Case(
        26, "grazing view and light", "shading and light transport", "n.v, n.l in {1, 1e-2, 1e-4, 0, -1e-4}",
        "dense shading in float64", "1e-4; zero below the horizon", (BRDF, HAZARDS),
    ),
    Case(
        27, "energy conservation", "shading and light transport", "64 view angles, roughness 0.02 to 1",
        "quadrature over half-vectors", "at most 1 + 1e-3", (BRDF,), (),
        "white albedo and the lobe together send out up to 1.08 at roughness 0.3 and 1.16 at 0.02: the paper's BRDF"
        " keeps Lambert's albedo / pi whole instead of weighting it by 1 - F; the lobe alone holds",
    ),
    Case(
        28, "white furnace", "shading and light transport", "albedo 1, light 1, N_s from 1 to 1024", "radiance 1",
        "1e-5 for the fixed set (measured 1.8e-7); 3 sigma + 4e-4 of the midpoint rule for the mixture",
        (BRDF,),
        ("method/core/kernels/test_shade.py::test_white_furnace_has_no_bias_at_any_number_of_samples",),
    ),
    Case(
        29, "closed furnace", "shading and light transport", "glowing sphere, albedo .2, .5, .8, .99, 8 to 16 bounces",
        "(1 - a^(k+1)) / (1 - a)", "2 % in the mean (32 directions a surfel)", (BRDF,),
    ),
    Case(
        30, "sampler against density", "shading and light transport", "hemisphere, random, light, mixture",
        "chi-square; integral of the density", "p > 1e-4; 1 +- 1e-3; the method has no GGX sampler", (HAZARDS,),
        (
            "method/core/transport/test_sampling.py::test_the_hemisphere_set_fills_equal_solid_angles_and_is_turned_at_random",
            "method/core/transport/test_sampling.py::test_the_random_direction_is_uniform_over_the_hemisphere",
            "method/core/transport/test_sampling.py::test_draws_from_the_light_follow_its_density_also_inside_each_texel",
            "method/core/transport/test_sampling.py::test_the_lights_density_integrates_to_one_and_is_the_mean_of_the_lookup_up_to_scale",
        ),
    ),
    Case(
        31, "mixture weights", "shading and light transport", "light alone, half and half, a quarter, with a lobe",
        "equal means", "|z| < 4 between every pair", (LIGHT,),
        ("method/core/transport/test_sampling.py::test_every_mixture_of_strategies_estimates_the_same_irradiance",),
    ),
    Case(
        32, "tangent frame", "shading and light transport", "n = -z, tilted by 1e-1 to 1e-8, and random",
        "R^T R = 1, R z = n, det = 1", "4 eps (measured 1.5)", (),
        ("method/core/transport/test_sampling.py::test_frames_are_orthonormal_down_to_the_south_pole_in_float32",),
    ),
    Case(
        33, "sun, black map, broken texel", "shading and light transport", "one texel 1e5; all 0; one NaN or infinity",
        "the density of the texel; uniform draws; a named error", "1e-5; exact", (),
        (
            "method/core/transport/test_sampling.py::test_a_sun_in_one_texel_is_found_by_three_draws_of_four",
            "method/core/transport/test_sampling.py::test_a_black_light_is_drawn_from_uniformly",
            "method/core/transport/test_sampling.py::test_a_light_that_is_not_finite_is_refused_by_name",
        ),
    ),
    Case(
        34, "poles and seam", "shading and light transport", "+-z, azimuth +-pi with either zero, texels' edges",
        "the map's own lookup; continuity", "1e-5", (),
        (
            "method/core/kernels/test_shade.py::test_lookup_crosses_the_seam_and_reaches_the_poles_without_a_step",
            "method/core/scene/test_light.py::test_lookup_is_continuous_across_the_seam_and_finite_with_its_gradient_at_the_poles",
        ),
    ),
    Case(
        35, "prefiltered light", "shading and light transport", "constant map, and a delta map at every texel",
        "the same constant; equal energy", "1e-4", (LIGHT,),
        ("method/core/transport/test_prefiltered_light.py::test_a_constant_light_stays_the_same_constant_at_every_roughness",),
    ),
    Case(
        36, "visibility at the edges", "shading and light transport", "0, 1 and many hits; a wall with a hole",
        "the product; 0 <= V <= 1, falling with every occluder",
        "1e-6; at the paper's stop V steps by at most its 3 %", (LIGHT, HAZARDS),
    ),
    Case(
        37, "indirect light off", "shading and light transport", "the same directions, the surfels met are black",
        "equality", "bit for bit", (LIGHT,),
    ),
    Case(
        38, "radiometric fixed point", "shading and light transport", "radiance of a matte surface in all directions",
        "residual 0", "1e-5", (),
        ("method/radiogs/test_consistency.py::test_physical_radiance_in_all_directions_has_no_loss",),
    ),
    Case(
        39, "division by alpha at 0", "autograd and precision", "depth and normals of background pixels",
        "zero gradient", "exactly 0", (PRECISION,),
    ),
    Case(
        40, "normalise(0)", "autograd and precision", "coinciding points, blends of opposite normals",
        "zero, or the derivative 1 / length", "at most 1e4 at lengths of the scene; 0 below float32's range",
        (PRECISION,),
        ("method/core/learning/test_losses.py::test_depth_normals_of_coinciding_points_are_zero_with_zero_gradient",),
    ),
    Case(
        41, "sRGB knees", "autograd and precision", "-1e-3, 0, 1e-12, the knee, and 10 to 1e4 of it",
        "colour-science in float64", "last digits of the type; slope 12.92 at and below the knee", (),
        (
            "method/core/scene/test_colour.py::test_transfer_functions_are_colour_sciences",
            "method/core/scene/test_colour.py::test_slope_at_and_below_the_knee_is_finite",
            "method/core/kernels/test_image.py::test_the_curve_is_good_to_the_last_digits_of_its_type",
        ),
    ),
    Case(
        42, "finite differences of the renderer", "autograd and precision",
        "8 surfels, every raw parameter and the light, 5 scenes, 10 directions each", "central differences in float64",
        "1e-3, cosine above 0.9999, no parameter without gradient; 1e-6 for the turn of a surfel's view",
        (PRECISION,),
    ),
    Case(
        43, "reduced precision", "autograd and precision", "half and bfloat16 tensors; matrix products at 'medium'",
        "float32", "refused by name; at least 60 dB (on CUDA marked gpu)", (PRECISION,),
    ),
    Case(
        44, "repetition", "autograd and precision", "the same seed twice, on 1 and 4 threads", "the first run",
        "bit for bit within a team, images also between teams; gradients between teams 1e-5", (PRECISION,),
        ("method/radiogs/test_stages.py::test_runs_of_equal_seeds_count_equal_work",),
    ),
    Case(
        45, "resuming", "autograd and precision", "a stage whole against half, saved, read and finished",
        "the whole run", "bit for bit", (),
        (
            "method/radiogs/test_stages.py::test_initialisation_resumes_bit_for_bit_across_density_control",
            "method/radiogs/test_stages.py::test_inverse_rendering_resumes_bit_for_bit_across_a_refresh",
        ),
    ),
    Case(
        46, "hidden and permuted primitives", "autograd and precision", "1000 behind a wall; shuffled", "invariance",
        "bit for bit; 1e-5", (INVARIANCE,),
        ("method/core/kernels/test_rasterize.py::test_order_of_the_surfels_does_not_matter",),
    ),
    Case(
        47, "identical images", "metrics", "x = y", "a cap of 100 dB by rule", "exact", (),
        ("metrics/test_pictures.py::test_identical_images_and_channels_are_capped",),
    ),
    Case(
        48, "constant and tiny images", "metrics", "1x1 to 11x20, all 0, odd windows", "analytic luminance term",
        "1e-6, or a named error", (),
        (
            "metrics/test_pictures.py::test_constant_images_have_only_the_luminance_term",
            "metrics/test_pictures.py::test_an_image_is_scored_or_named_too_small",
        ),
    ),
    Case(
        49, "masks", "metrics", "empty, one pixel, full; NaN outside", "named n/a; invariance to what is outside",
        "exact", (),
        (
            "metrics/test_pictures.py::test_pixels_outside_a_mask_do_not_count_even_if_nan",
            "metrics/test_shape.py::test_nan_outside_the_mask_does_not_leak_and_an_empty_mask_has_no_figure",
        ),
    ),
    Case(
        50, "scale alignment", "metrics", "zero albedo, one channel 0, 1 % outliers, negative",
        "NumPy's medians and least squares", "1e-5 (float32 ratios); equivariance", (),
        (
            "metrics/test_albedo.py::test_factors_are_numpys",
            "metrics/test_albedo.py::test_a_channel_that_is_zero_stays_finite",
            "metrics/test_albedo.py::test_a_hundredth_of_outliers_moves_the_median_by_little",
        ),
    ),
    Case(
        51, "normal error", "metrics", "0 to 180 degrees, lengths 1e-3 to 7, zero normals", "atan2 in float64",
        "1e-6 rad", (),
        (
            "metrics/test_shape.py::test_the_angle_is_exact_from_identical_to_anti_parallel",
            "metrics/test_shape.py::test_identical_float32_normals_are_at_no_angle",
        ),
    ),
    Case(
        52, "summation", "metrics", "10^7 pixels with error 1e-4 and seven of 1", "closed form", "1e-9", (),
        ("metrics/test_pictures.py::test_ten_million_small_errors_and_a_few_large_ones_are_summed_without_loss",),
    ),
)  # fmt: skip
