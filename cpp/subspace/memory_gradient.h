// The majorize-minimize memory-gradient step (E. Chouzenoux, J. Idier & S. Moussaoui, IEEE Trans. Image Process.
// 20:1517, 2011). Called by bindings/ for the optimizers "momentum" and "subsets"; uses all threads.
#pragma once
#include "statistics/mrf_prior.h"
#include <cstdint>

namespace palpate {

// What a memory-gradient step needs besides projections: the objective's parabola in the plane of two directions, the
// new one u and the last step p. Volumes are
// (nz, ny, nx), sums are made block by block, so that they do not depend on the number of threads.

// Σ over pairs of ω ψ'(t)/t · (Δu², Δu Δp, Δp²): the curvatures of a parabola above the prior at f, p = f − previous.
// Of some slices: their pairs with each other and with the next slice.
void prior_curvatures(const Neighbourhood& n, const float* f, const float* previous, const float* u, Slices slices,
                      double curvatures[3]);

// Σ_i curvature_i · (q_i², q_i s_i, s_i²), q = A u, s = l − l_previous.
void data_curvatures(const float* curvature, const float* l, const float* previous, const float* q, int64_t size,
                     double curvatures[3]);

// A diagonal above the data's curvature, Σ_i a_ij c_i Σ_k a_ik, on cells of step x step voxels of a slice: it is
// smooth.
constexpr int64_t coarse_step = 8; // or 1
struct Majorizer {
    const float* values; // (nz, ny, nx) cells
    int64_t ny, nx, step;
};

// Turns the data's gradient in u into the scaled direction: u = −g / (data + 2β bend) with g = gradient + β slope,
// slope and bend those of the prior at f; 0 where f is 0 and would sink, or where nothing is known. slopes: g·u and
// g·p. In some slices, of which the sums are.
void search_direction(const Neighbourhood& n, const Majorizer& data, float beta, const float* f, const float* previous,
                      Slices slices, float* u, double slopes[2]);

// u becomes [f + w0 u + w1 (f − previous)]₊.
void advance(const float* f, const float* previous, const double w[2], int64_t size, float* u);

} // namespace palpate
