// The Markov random field prior: its value, and gradient and curvature of its separable parabola surrogate.
// Called by the objective of every penalized method, on the caller's thread; in parallel over slices or rows.
#pragma once
#include "statistics/potential_function.h"
#include <cstdint>

namespace palpate {

// R(f) = Σ over pairs of neighbours of ω ψ(f_j − f_s), each pair once: 6 neighbours that share a face, 18 that share at
// least an edge, or 26 that share at least a vertex.
struct Neighbourhood {
    int64_t nz, ny, nx;
    float weight[3][3][3]; // ω of the step (dz, dy, dx) at [dz + 1][dy + 1][dx + 1], mm; 0 where no neighbour
    PotentialParameters law;
};

// ω = V / (d·d̄): V the volume of a voxel, d the distance of the pair, d̄ the smallest spacing. spacing: (z, y, x), mm.
Neighbourhood neighbourhood(const int64_t shape[3], const double spacing[3], const PotentialParameters& law,
                            int neighbours);

// f: (nz, ny, nx) 1/mm.
double prior_value(const Neighbourhood& n, const float* f);

// gradient_j = Σ_s ω ψ'(f_j − f_s) and curvature_j = Σ_s ω ψ'(t)/t (of the parabola in f_j alone), both (nz, ny, nx).
void prior_surrogate(const Neighbourhood& n, const float* f, float* gradient, float* curvature);

// The same sums for voxels begin .. end - 1 of one row, over their 24 neighbours in other rows. Both (end - begin).
void prior_across_rows(const Neighbourhood& n, const float* f, int64_t z, int64_t y, int64_t begin, int64_t end,
                       float* gradient, float* curvature);

} // namespace palpate
