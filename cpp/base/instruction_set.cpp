#include "base/instruction_set.h"
#include "base/cpu_dispatch.h"

namespace palpate {

const char* instruction_set() {
#if defined(PALPATE_VERSIONS)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw")) return "x86-64-v4 (AVX-512)";
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return "x86-64-v3 (AVX2)";
    return "baseline";
#elif defined(__AVX512VL__)
    return "x86-64-v4 (AVX-512)";
#elif defined(__AVX2__)
    return "x86-64-v3 (AVX2)";
#else
    return "baseline";
#endif
}

} // namespace palpate
