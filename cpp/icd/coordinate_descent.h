// One sweep of coordinate descent over the volume on paraboloidal surrogates. Called by bindings/icd.cpp;
// uses all threads. Source: PS,P,CD, H. Erdogan & J. A. Fessler, IEEE Trans. Med. Imaging 18:801, 1999.
#pragma once
#include "icd/surrogate_images.h"
#include "statistics/mrf_prior.h"
#include <cstdint>

namespace palpate {

// beta: weight of the prior. relaxation: 1 moves each voxel to the minimum of its parabola; up to 2 it overshoots and
// the parabola's value still never rises (over-relaxation, which speeds up smooth errors). backwards: the reverse
// order. first, end: the slices that are swept, from the beginning of a slab to the end of one; all by default.
struct Sweep {
    float beta, relaxation;
    bool backwards;
    int first = 0, end = INT32_MAX;
};

// One sweep of coordinate descent over f (z, y, x) on the paraboloid + β·prior: each voxel along its parabola, clipped
// at 0, the slopes following at once. support: (z, y, x), 0 where f is held at 0, or null. Order: slabs of a few
// slices; in a slab, blocks of 8·stride rows, the even ones and then the odd ones; in a block, parts of voxels_at_once
// along x; in a part, slices; in a slice, classes of rows y = class, class + stride, ...; in a class, rows; in a row,
// x. Rows of a class share no pixel and no pair of neighbours, nor do blocks of one parity, so lanes over the rows and
// threads over the blocks give exactly the sequential answer. In a part the images stay in cache, for all slices of the
// slab.
void descend(const Neighbourhood& neighbours, const Sweep& sweep, SurrogateImages& data, float* f,
             const uint8_t* support = nullptr);

// How many of every/2, every/2 + every, ... lie below n.
inline int sampled(int n, int every) { return (n - every / 2 + every - 1) / every; }

// d_j = Σ_i a_ij² curvature_i, the paraboloid's curvature in each voxel of every so-many-th slice and row: d (sampled
// slices, sampled rows, x).
void diagonal(SurrogateImages& data, int every, int every_row, float* d);

} // namespace palpate
