#pragma once
#include "band_kernels.h"
#include "buffer.h"
#include "lanes.h"
#include "terms.h"
#include <algorithm>

namespace palpate {

// The weights of one slice along x in a view, laid out as the descent reads them. A row of voxels is a problem in one
// dimension: from the columns' sums of slope and curvature (weighed along y, see SliceView) come each voxel's slope and
// how it is coupled to those ahead, and its solution goes back to the columns. Where each voxel begins a column or more
// behind the one before, few share a column: the bands of the matrix that couples them are worked out at once, eight
// voxels or columns a vector. Others are walked (see Walk).
class Bands {
public:
    void make(const Geometry& geometry, const View& view, int z, Axis axis, int columns);
    bool walked() const { return kernel == 0; }
    int products() const { return terms; }
    // Whether one of voxels begin .. end - 1 has a shadow on the panel; if none has, they reach no column.
    bool sees(int begin, int end) const { return begin < seen_end && end > seen_begin; }
    // First column under it, rounded down to a multiple of eight, and the one after the last.
    int begin(int voxel) const { return std::max(0, std::min(columns - 1, first[voxel])) / lanes * lanes; }
    int end(int voxel) const { return std::min(columns, first[voxel] + taps); }

    // Of voxels that are walked: the columns under one, and its weights there, (columns, terms).
    int touched(int voxel) const { return count[voxel]; }
    int first_touched(int voxel) const { return low[voxel]; }
    const float* along(int voxel) const { return &weight[size_t(voxel) * taps * terms]; }

    // Of the others.
    int reach() const { return ahead; }     // a voxel shares columns with so many ahead of it
    int planes() const { return 1 + taps; } // of `look`
    int margin() const { return around; }   // voxels before and behind a part that `spread` reads

    // Adds to planes 0: slope, 1 + k: coupling of voxel x with x + k, of voxels begin .. end - 1 (begin a multiple of
    // eight; up to a multiple of eight of them) what the columns' sums say: for every term of slope, for every pair of
    // terms of curvature; sums[0] is column `from`. Up to `beside` floats before and behind are read too, and count for
    // nothing.
    static constexpr int beside = 4 * lanes;
    void look(Looked rows, int from, int begin, int end) const;

    // out[term * pitch + a] = Σ over voxels of weight · change, for columns from + a, n of them (both multiples of
    // eight). change: of voxel begin, with `margin` 0s or more on either side of the part.
    void spread(const float* change, int begin, int from, int n, float* out, int64_t pitch) const;

private:
    int terms = 0, taps = 0, ahead = 0, columns = 0, around = 0;
    int kernel = 0;     // which one looks: 10 · terms + taps; 0 where voxels are walked
    bool close = false; // eight neighbouring voxels touch sixteen columns at most
    Span spread_span = Span::any;
    int spread_taps = 0;
    int seen_begin = 0, seen_end = 0;        // voxels with a shadow on the panel
    std::vector<int32_t> first, first_voxel; // under a voxel; over a column
    Buffer weight, spread_weight;

    std::vector<AxisWeights> parts; // scratch, per term
    std::vector<int32_t> low, count;
    std::vector<float> dense; // see `lay_out`
    void place();
    void lay_out();
    void couple();
    void turn();
    const float* at(int voxel, int term, int shift) const {
        return &dense[(size_t(voxel) * terms + term) * 2 * taps + taps - std::min(shift, taps)];
    }
    template <int terms, int taps> void couple_by();
    void list();
};

} // namespace palpate
