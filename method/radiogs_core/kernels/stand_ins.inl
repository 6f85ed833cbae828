// Put before every snippet that is arranged for CUDA; see native_kernel.py.

// ---- stand_ins
#if ON_CUDA && !defined(__CUDA_ARCH__)
#define __ffs(bits) __builtin_ffs(bits)
#define atomicAdd(address, value) *(address) += (value)
#endif
