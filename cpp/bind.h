#pragma once
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

namespace nb = nanobind;

// One function a link of the chain; bind.cpp calls them in the order of the data.
void bind_projection(nb::module_& m);     // projector and its transpose
void bind_reconstruction(nb::module_& m); // likelihood, prior, descent
void bind_mechanics(nb::module_& m);      // springs, blocks
void bind_multigrid(nb::module_& m);      // the ladder's multigrid
void bind_hyperelastic(nb::module_& m);   // neo-Hookean elements at finite strain
void bind_simulation(nb::module_& m);     // the 1 kHz loop
void bind_timing(nb::module_& m);         // what its ticks cost, and the machine's own jitter
void bind_haptics(nb::module_& m);        // servo and drivers of haptic devices
void bind_factors(nb::module_& m);        // sparse Cholesky factors
void bind_compliance(nb::module_& m);     // Green's functions

template <class T, int rank> using Array = nb::ndarray<T, nb::ndim<rank>, nb::c_contig, nb::device::cpu>;
template <class T, int rank> using In = nb::ndarray<const T, nb::ndim<rank>, nb::c_contig, nb::device::cpu>;
