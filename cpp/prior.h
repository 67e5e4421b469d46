#pragma once
#include <cstdint>

namespace palpate {

enum class Potential { quadratic, huber, lange };

// R(f) = Σ over pairs of neighbours of ω ψ(f_j − f_s): 26 neighbours (voxels that share at least a vertex), each pair
// once.
struct Neighbourhood {
    int64_t nz, ny, nx;
    float weight[3][3][3]; // ω for the step (dz, dy, dx) − 1, mm; the middle is 0
    Potential potential;
    float edge; // δ, 1/mm
};

// ω = V / (d·d̄): V the voxel's volume, d the pair's distance, d̄ the smallest spacing; spacing (z, y, x) in mm.
Neighbourhood neighbourhood(const int64_t shape[3], const double spacing[3], Potential potential, double edge);

// f: (nz, ny, nx) 1/mm.
double prior_value(const Neighbourhood& n, const float* f);

// gradient_j = Σ_s ω ψ'(f_j − f_s) and curvature_j = Σ_s ω ψ'(t)/t (of the parabola in f_j alone), both (nz, ny, nx).
void prior_surrogate(const Neighbourhood& n, const float* f, float* gradient, float* curvature);

// The same sums for voxels begin .. end - 1 of one row, over the 24 neighbours outside the row. gradient, curvature:
// (end - begin).
void prior_across_rows(const Neighbourhood& n, const float* f, int64_t z, int64_t y, int64_t begin, int64_t end,
                       float* gradient, float* curvature);

// ψ'(t)/t, so ψ'(t) = t·curvature.
inline __attribute__((always_inline)) float potential_curvature(Potential potential, float t, float edge) {
    float size = t < 0 ? -t : t;
    if (potential == Potential::lange) return edge / (edge + size);
    if (potential == Potential::huber) return size > edge ? edge / size : 1.0f;
    return 1.0f;
}

} // namespace palpate
