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
    // (nz, ny, nx) Σ ω over the neighbours of each voxel that lie outside the object's support, where f is 0; such
    // pairs do not count. Null where there is no support.
    const float* outside = nullptr;
};

// ω = V / (d·d̄): V the volume of a voxel, d the distance of the pair, d̄ the smallest spacing. spacing: (z, y, x), mm.
Neighbourhood neighbourhood(const int64_t shape[3], const double spacing[3], const PotentialParameters& law,
                            int neighbours);

// Calls visit(x, Σ ω) for each of voxels begin .. end - 1 of a row that has neighbours outside the support.
template <class Visit>
void for_each_at_border(const Neighbourhood& n, int64_t z, int64_t y, int64_t begin, int64_t end, Visit visit) {
    if (!n.outside) return;
    const float* row = n.outside + (z * n.ny + y) * n.nx;
    for (int64_t x = begin; x < end; x++)
        if (row[x] != 0) visit(x, row[x]);
}

// Takes the pairs with voxels outside the support out of the sums of a row's voxels begin .. end - 1: there f is 0.
// row: of f; slope, curvature: (end - begin).
void leave_out_border(const Neighbourhood& n, const float* row, int64_t z, int64_t y, int64_t begin, int64_t end,
                      float* slope, float* curvature);

// Calls visit(first, there, count, weight) for each of the 13 steps that lead forward from a row of voxels: its voxels
// from `first` on have `count` neighbours, which lie from `there` on, counted from the row's first voxel.
template <class Visit> void for_each_forward_step(const Neighbourhood& n, int64_t z, int64_t y, Visit visit) {
    for (int64_t dz = 0; dz <= 1; dz++)
        for (int64_t dy = -1; dy <= 1; dy++)
            for (int64_t dx = -1; dx <= 1; dx++) {
                if (dz * 9 + dy * 3 + dx <= 0 || z + dz >= n.nz || y + dy < 0 || y + dy >= n.ny) continue;
                const int64_t first = dx < 0 ? 1 : 0, there = (dz * n.ny + dy) * n.nx + first + dx;
                const float weight = n.weight[dz + 1][dy + 1][dx + 1];
                if (weight != 0) visit(first, there, n.nx - (dx != 0), weight);
            }
}

// Slices first .. end - 1 of a volume.
struct Slices {
    int64_t first, end;
};
inline Slices all_slices(const Neighbourhood& n) { return {0, n.nz}; }

// f: (nz, ny, nx) 1/mm. Of some slices: their pairs with each other and with the next slice.
double prior_value(const Neighbourhood& n, const float* f, Slices slices);
inline double prior_value(const Neighbourhood& n, const float* f) { return prior_value(n, f, all_slices(n)); }

// gradient_j = Σ_s ω ψ'(f_j − f_s) and curvature_j = Σ_s ω ψ'(t)/t (of the parabola in f_j alone), both (nz, ny, nx).
void prior_surrogate(const Neighbourhood& n, const float* f, float* gradient, float* curvature);

// The same sums for voxels begin .. end - 1 of one row, over their 24 neighbours in other rows. Both (end - begin).
void prior_across_rows(const Neighbourhood& n, const float* f, int64_t z, int64_t y, int64_t begin, int64_t end,
                       float* gradient, float* curvature);

} // namespace palpate
