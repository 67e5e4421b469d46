#include "bind.h"
#include "dispatch.h"
#include "parallel.h"

using namespace nb::literals;

NB_MODULE(_core, m) {
    m.doc() = "palpate's kernels; see cpp/";
    m.def("threads", &palpate::threads, "Number of threads the kernels use.");
    m.def("set_threads", &palpate::set_threads, "n"_a, "Sets the number of threads; 0 gives back the default.");
    m.def(
        "instruction_set",
        [] {
#ifdef PALPATE_VERSIONS
            __builtin_cpu_init();
            if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw")) return "x86-64-v4 (AVX-512)";
            if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return "x86-64-v3 (AVX2)";
#endif
            return "baseline";
        },
        "The version of the hot kernels that this machine runs.");
    bind_projection(m);
    bind_reconstruction(m);
    bind_factors(m);
    bind_mechanics(m);
    bind_multigrid(m);
    bind_hyperelastic(m);
    bind_compliance(m);
    bind_simulation(m);
    bind_timing(m);
    bind_haptics(m);
}
