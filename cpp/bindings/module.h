#pragma once
// One function for each submodule of palpate._core; module.cpp calls them in the order of the folders in
// CMakeLists.txt, so that a type is known before another submodule names it. With the interpreter's lock held.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <stdexcept>

namespace nb = nanobind;

void bind_base(nb::module_& m);
void bind_volume(nb::module_& m);
void bind_phantom(nb::module_& m);
void bind_projection(nb::module_& m);
void bind_statistics(nb::module_& m);
void bind_icd(nb::module_& m);
void bind_subspace(nb::module_& m);
void bind_linalg(nb::module_& m);
void bind_tissue(nb::module_& m);
void bind_relaxation(nb::module_& m);
void bind_multigrid(nb::module_& m);
void bind_compliance(nb::module_& m);
void bind_hyperelastic(nb::module_& m);
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
