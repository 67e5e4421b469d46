// Macros that compile a kernel for several instruction sets and choose one at run time. Used by all kernels.
#pragma once

// A function marked PALPATE_KERNEL is compiled three times, and the loader picks the version for the machine's CPU. It
// must be a plain function, without lambdas in its hot loop (they do not inherit the target), and its helpers must be
// PALPATE_INLINE, for the same reason.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && defined(__linux__) && !defined(PALPATE_BASELINE)
#define PALPATE_VERSIONS // there is more than one version
#define PALPATE_KERNEL __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define PALPATE_KERNEL
#endif
#if defined(PALPATE_VERSIONS) || defined(__AVX512VL__)
#define PALPATE_AVX512 // kernels that need its 32 registers may be compiled
#endif
#define PALPATE_INLINE inline __attribute__((always_inline))
