// Adam's step for a block of entries of one of several tensors; see adam.py.

// ---- step
// A row of ``memory`` has the addresses of a tensor's values, gradients and two moments, and a row of ``factors`` its
// step length and the two corrections by which its moments become unbiased: 1 - beta_1^t and the root of 1 - beta_2^t.
int tensor = 0;
while (block >= ends.data[tensor]) ++tensor;
const long long first = (long long)(block - (tensor > 0 ? ends.data[tensor - 1] : 0)) * BLOCK_ENTRIES;
const long long rest = lengths.data[tensor] - first;
const int count = rest < BLOCK_ENTRIES ? (int)rest : BLOCK_ENTRIES;
const long long* at = memory.data + 4 * tensor;
SCALAR* __restrict__ const value = (SCALAR*)at[0] + first;
const SCALAR* __restrict__ const gradient = (const SCALAR*)at[1] + first;
SCALAR* __restrict__ const mean = (SCALAR*)at[2] + first;
SCALAR* __restrict__ const square = (SCALAR*)at[3] + first;
const SCALAR length = SCALAR(factors.data[3 * tensor] / factors.data[3 * tensor + 1]);
const SCALAR scale = SCALAR(1.0 / factors.data[3 * tensor + 2]);
for (int i = 0; i < count; ++i) {
    const SCALAR g = gradient[i];
    const SCALAR m = mean[i] + SCALAR(1.0 - MEAN_DECAY) * (g - mean[i]);
    const SCALAR s = SCALAR(SQUARE_DECAY) * square[i] + SCALAR(1.0 - SQUARE_DECAY) * g * g;
    mean[i] = m;
    square[i] = s;
    value[i] -= length * m / (scale * sqrt(s) + SCALAR(GUARD));
}
