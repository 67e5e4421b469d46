#pragma once

// Hot kernels are compiled three times; the loader picks the version for the machine's CPU. Functions so marked must be
// plain (no templates, no lambdas inside the hot loop: those do not inherit the target), their helpers always inlined.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && defined(__linux__) && !defined(PALPATE_BASELINE)
#define PALPATE_VERSIONS // there are some to choose from
#define PALPATE_KERNEL __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define PALPATE_KERNEL
#endif
#define PALPATE_INLINE inline __attribute__((always_inline))
