// A surfel as rays meet it; see axes.py.

// ---- given
const SCALAR* m = frame.data + 9LL * surfel;
const SCALAR s_u = wp::exp(log_scale.data[2LL * surfel]), s_v = wp::exp(log_scale.data[2LL * surfel + 1]);
const SCALAR peak = SCALAR(1) / (SCALAR(1) + wp::exp(-opacity_logit.data[surfel]));

// ---- forward
#include "given"
for (int k = 0; k < 3; ++k) {
    out_u.data[3LL * surfel + k] = m[3 * k] / s_u;
    out_v.data[3LL * surfel + k] = m[3 * k + 1] / s_v;
    out_normal.data[3LL * surfel + k] = m[3 * k + 2];
}
out_opacity.data[surfel] = peak;

// ---- backward
// An axis falls with the logarithm of its scale as fast as it is long.
#include "given"
const SCALAR *by_u = pull_u.data + 3LL * surfel, *by_v = pull_v.data + 3LL * surfel;
SCALAR *to_frame = to_frames.data + 9LL * surfel, along_u = SCALAR(0), along_v = SCALAR(0);
for (int k = 0; k < 3; ++k) {
    to_frame[3 * k] = by_u[k] / s_u;
    to_frame[3 * k + 1] = by_v[k] / s_v;
    to_frame[3 * k + 2] = pull_normal.data[3LL * surfel + k];
    along_u += by_u[k] * m[3 * k];
    along_v += by_v[k] * m[3 * k + 1];
}
to_log_scales.data[2LL * surfel] = -along_u / s_u;
to_log_scales.data[2LL * surfel + 1] = -along_v / s_v;
to_logits.data[surfel] = pull_opacity.data[surfel] * peak * (SCALAR(1) - peak);
