#pragma once
// One function for each submodule of palpate._core; module.cpp calls them in the order of the folders in
// CMakeLists.txt, so that a type is known before another submodule names it. With the interpreter's lock held.
#include <algorithm>
#include <cmath>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <stdexcept>
#include <vector>

namespace nb = nanobind;

void bind_base(nb::module_& m);
void bind_volume(nb::module_& m);
void bind_phantom(nb::module_& m);
void bind_scatter(nb::module_& m);
void bind_projection(nb::module_& m);
void bind_statistics(nb::module_& m);
void bind_icd(nb::module_& m);
void bind_subspace(nb::module_& m);
void bind_linalg(nb::module_& m);
void bind_cutting(nb::module_& m);
void bind_tissue(nb::module_& m);
void bind_elements(nb::module_& m);
void bind_relaxation(nb::module_& m);
void bind_multigrid(nb::module_& m);
void bind_compliance(nb::module_& m);
void bind_hyperelastic(nb::module_& m);
void bind_multirate(nb::module_& m);
void bind_simulation(nb::module_& m);
void bind_haptics(nb::module_& m);
void bind_benchmark(nb::module_& m);

template <class T, int rank> using Array = nb::ndarray<T, nb::ndim<rank>, nb::c_contig, nb::device::cpu>;
// Refuses what a kernel could not survive. What must be true of an argument beyond its type is checked by the bindings.
inline void expect(bool good, const char* what) {
    if (!good) throw std::invalid_argument(what);
}

template <class T, int rank> using In = nb::ndarray<const T, nb::ndim<rank>, nb::c_contig, nb::device::cpu>;

// At least `least`, at most `most`; not NaN.
template <class T> bool within(T value, T least, T most) { return value >= least && value <= most; }

// Each element: is finite; is the number of one of `count` things.
template <class Values> void expect_finite(const Values& a, const char* what) {
    expect(std::all_of(a.data(), a.data() + a.size(), [](double v) { return std::isfinite(v); }), what);
}
template <class Values> void expect_numbers(const Values& a, size_t count, const char* what) {
    expect(std::all_of(a.data(), a.data() + a.size(), [&](int v) { return v >= 0 && size_t(v) < count; }), what);
}
inline void expect_vectors(const In<double, 2>& a, size_t count, const char* what) {
    expect(a.shape(0) == count && a.shape(1) == 3, what);
}

template <class T> std::vector<T> listed(const nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>& a) {
    return {a.data(), a.data() + a.size()};
}

// An argument whose array is taken as it is, never converted.
inline auto operator""_as_is(const char* name, size_t) { return nb::arg(name).noconvert(); }

// What f returns, without the interpreter's lock meanwhile.
template <class F> auto unlocked(F f) {
    nb::gil_scoped_release release;
    return f();
}
