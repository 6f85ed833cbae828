"""The specular lobe D F V of one sample towards one view: text of native snippets."""

import torch

from .brdf import FRESNEL_NORMAL

EXP_TERMS = {torch.float32: 8, torch.float64: 15}
"""Terms of the series of exp down to -0.55 that reach the last digit of each type."""

LOBE_FUNCTIONS = """
    // Schlick's F: 2^p = (e^(p log(2) / 16))^16, with -12.6 < p < 0.
    auto fresnel = [](SCALAR cosine) -> SCALAR {
        const SCALAR p = (SCALAR(-5.55473) * cosine - SCALAR(6.98316)) * cosine;
        const SCALAR z = p * SCALAR(0.69314718055994530942 / 16);
        SCALAR power = 1;
        for (int term = EXP_TERMS; term > 0; --term) power = SCALAR(1) + z * power * (SCALAR(1) / SCALAR(term));
        for (int doubling = 0; doubling < 4; ++doubling) power *= power;
        return SCALAR(F0) + SCALAR(1 - F0) * power;
    };
    // What rounding took from the sum a + b.
    auto rest_of = [](SCALAR a, SCALAR b, SCALAR sum) -> SCALAR {
        const SCALAR taken = sum - a;
        return (a - (sum - taken)) + (b - taken);
    };
"""
"""``fresnel`` and ``rest_of``, for ``lobe_words``."""

# t = n x s decides how far a sharp lobe is off its peak. Of s itself the products would cancel; so its part along n is
# taken out first and what its rounding lost is put back (at roughness 0.02 the lobe is good to 1e-6 instead of 2e-4).
LOBE = """
                const SCALAR sx = wx[c] + ox, sy = wy[c] + oy, sz = wz[c] + oz;
                const SCALAR length_squared = sx * sx + sy * sy + sz * sz;
                const SCALAR along = view_cosine + light_cosine[c];
                const SCALAR px = (sx - along * nx) + rest_of(wx[c], ox, sx);
                const SCALAR py = (sy - along * ny) + rest_of(wy[c], oy, sy);
                const SCALAR pz = (sz - along * nz) + rest_of(wz[c], oz, sz);
                const SCALAR tx = ny * pz - nz * py, ty = nz * px - nx * pz, tz = nx * py - ny * px;
                const SCALAR spread = alpha_squared * along * along + tx * tx + ty * ty + tz * tz;
                const SCALAR peak = length_squared / spread;
                const SCALAR cosine = (ox * sx + oy * sy + oz * sz) / wp::sqrt(length_squared);
                const SCALAR light_term = light_cosine[c] * (one - k) + k;
                const SCALAR shape = alpha_squared * peak * peak / (SCALAR(4) * pi * view_term * light_term);
                const SCALAR lobe = shape * fresnel(cosine);
"""
"""``lobe`` for lane ``c``, and what its gradient needs; see the kernels of shading for what it reads."""


def lobe_words(dtype: torch.dtype) -> dict[str, str]:
    """What the words of both texts mean for a scalar type."""
    return {"EXP_TERMS": str(EXP_TERMS[dtype]), "F0": repr(FRESNEL_NORMAL)}
