#pragma once
#include "geometry.h"
#include "pages.h"
#include "prior.h"
#include <vector>

namespace palpate {

// The data's paraboloid, Σ_i slope_i t + curvature_i t²/2 around the line integrals of the current volume. Per view, on
// the pixels on which its footprints are products (the parallel panel), or else on the measured ones; the length of
// each ray's path is folded in: slope · path and curvature · path². Made once and set anew for every sweep: memory that
// the system has just handed out is slow.
class Paraboloid {
public:
    const Geometry& geometry;

    explicit Paraboloid(const Geometry& geometry);
    void set_slope(const float* slope) { fold(slope, 0); } // (views, rows, columns)
    void set_curvature(const float* curvature) { fold(curvature, 1); }
    float* slope(int view) { return images.data() + start[2 * view]; }
    const float* curvature(int view) const { return images.data() + start[2 * view + 1]; }

private:
    std::vector<int64_t> start;
    Pages images;

    void fold(const float* image, int order);
};

// beta: weight of the prior. relaxation: 1 moves each voxel to the minimum of its parabola; up to 2 it overshoots and
// the parabola's value still never rises (over-relaxation, which speeds up smooth errors). backwards: the reverse
// order.
struct Sweep {
    float beta, relaxation;
    bool backwards;
};

// One sweep of coordinate descent over f (z, y, x) on the paraboloid + β·prior (PS,P,CD: Erdogan & Fessler, IEEE Trans.
// Med. Imaging 18:801, 1999): each voxel along its parabola, clipped at 0, the slopes following at once.
// Order: slabs of a few slices; in a slab, blocks of 8·stride rows, the even ones and then the odd ones; in a block,
// parts of voxels_at_once along x; in a part, slices; in a slice, classes of rows y = class, class + stride, ...; in a
// class, rows; in a row, x. Rows of a class share no pixel and no pair of neighbours, nor do blocks of one parity, so
// lanes over the rows and threads over the blocks give exactly the sequential answer. In a part the images stay in
// cache, for all slices of the slab.
constexpr int voxels_at_once = 64;
void descend(const Neighbourhood& neighbours, const Sweep& sweep, Paraboloid& data, float* f);

// How many of every/2, every/2 + every, ... lie below n.
inline int sampled(int n, int every) { return (n - every / 2 + every - 1) / every; }

// d_j = Σ_i a_ij² curvature_i, the paraboloid's curvature in each voxel of every so-many-th slice and row: d (sampled
// slices, sampled rows, x).
void diagonal(Paraboloid& data, int every, int every_row, float* d);

} // namespace palpate
