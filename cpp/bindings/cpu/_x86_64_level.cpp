// The Python module palpate._x86_64_level: its `level` names the newest level of x86-64 that this CPU and system offer.
// palpate/__init__.py reads it once to choose among the modules that one compiler run made for each level; compiled for
// none of them. Intel, Software Developer's Manual, volume 1, chapter 14; x86-64 psABI, table 3.1.
#include <Python.h>
#include <cpuid.h>

namespace {

// Which registers the system saves at a change of threads.
unsigned saved_registers() {
    unsigned low, high;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return low;
}

const char* level() {
    unsigned a, b, c, d, wide = 0;
    if (!__get_cpuid(1, &a, &b, &c, &d)) return "x86-64";
    constexpr unsigned fma_movbe_osxsave_avx_f16c = 1 << 12 | 1 << 22 | 1 << 27 | 1 << 28 | 1 << 29;
    if ((c & fma_movbe_osxsave_avx_f16c) != fma_movbe_osxsave_avx_f16c) return "x86-64";
    constexpr unsigned bmi1_avx2_bmi2 = 1 << 3 | 1 << 5 | 1 << 8;
    constexpr unsigned avx512_f_dq_cd_bw_vl = 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31;
    if (!__get_cpuid_count(7, 0, &a, &wide, &c, &d) || (wide & bmi1_avx2_bmi2) != bmi1_avx2_bmi2) return "x86-64";
    constexpr unsigned avx_state = 0x6, avx512_state = 0xe6;
    const unsigned saved = saved_registers();
    if ((saved & avx512_state) == avx512_state && (wide & avx512_f_dq_cd_bw_vl) == avx512_f_dq_cd_bw_vl)
        return "x86-64-v4";
    return (saved & avx_state) == avx_state ? "x86-64-v3" : "x86-64";
}

} // namespace

PyMODINIT_FUNC PyInit__x86_64_level() {
    static PyModuleDef definition = {
        PyModuleDef_HEAD_INIT, "_x86_64_level", nullptr, -1, nullptr, nullptr, nullptr, nullptr, nullptr};
    PyObject* module = PyModule_Create(&definition);
    if (module && PyModule_AddStringConstant(module, "level", level()) < 0) Py_CLEAR(module);
    return module;
}
