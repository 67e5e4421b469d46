#pragma once
#include "potential.h"
#include <cstdint>

namespace palpate {

// R(f) = Σ over pairs of neighbours of ω ψ(f_j − f_s), each pair once: 6 neighbours that share a face, 18 that share at
// least an edge, or 26 that share at least a vertex.
struct Neighbourhood {
    int64_t nz, ny, nx;
    float weight[3][3]
                [3]; // ω for the step (dz, dy, dx) − 1, mm; the middle is 0, and so are those that are no neighbours
    Law law;
};

// ω = V / (d·d̄): V the voxel's volume, d the pair's distance, d̄ the smallest spacing; spacing (z, y, x) in mm.
Neighbourhood neighbourhood(const int64_t shape[3], const double spacing[3], const Law& law, int neighbours);

// f: (nz, ny, nx) 1/mm.
double prior_value(const Neighbourhood& n, const float* f);

// gradient_j = Σ_s ω ψ'(f_j − f_s) and curvature_j = Σ_s ω ψ'(t)/t (of the parabola in f_j alone), both (nz, ny, nx).
void prior_surrogate(const Neighbourhood& n, const float* f, float* gradient, float* curvature);

// The same sums for voxels begin .. end - 1 of one row, over the 24 neighbours outside the row. gradient, curvature:
// (end - begin).
void prior_across_rows(const Neighbourhood& n, const float* f, int64_t z, int64_t y, int64_t begin, int64_t end,
                       float* gradient, float* curvature);

} // namespace palpate
