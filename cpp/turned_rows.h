#pragma once
#include "weights.h"

namespace palpate {

// One row of voxels on a panel turned about y, where the weights along y differ by column.
struct TurnedRow {
    int taps = 0;
    std::vector<int32_t> low, high; // first and last row of the image under it, per column
    std::vector<float> weight;      // along y, (terms, taps, stride), tap 0 in row low
    std::vector<double> per_move;   // scratch

    void make(const std::vector<Rows>& edges, int y, int nb, int na, int64_t stride);
};

// What SliceView does with a row of voxels: sums over the image's rows in columns begin .. begin + n - 1, and back.
void turned_reduce(const TurnedRow& row, const float* slope, const float* curvature, int64_t stride, int terms,
                   int begin, int n, float* out, int64_t pitch);
void turned_expand(const TurnedRow& row, const float* change, int64_t pitch, const float* curvature, int64_t stride,
                   int terms, int begin, int n, float* slope);

// Rows of voxels this far apart share no pixel, nor does the work on one touch the other's.
int turned_rows_apart(const std::vector<Rows>& edges, int ny, int na);

} // namespace palpate
