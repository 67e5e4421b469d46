// The footprints along y of one row of voxels on a panel rotated about y. Made for each row by SliceView, on all
// threads.
#pragma once
#include "projection/footprint_weights.h"

namespace palpate {

// One row of voxels on a panel rotated about y, where the weights along y differ by column: columns begin .. end - 1,
// in vectors of eight that take the same rows of the image.
struct RotatedPanelRow {
    int begin = 0, end = 0, taps = 0;
    std::vector<int32_t> low, count; // first row of the image under a vector, and how many
    std::vector<float> weight;       // along y, (vectors, taps, terms, 8)

    // na: columns of the image; there is nothing in those beyond.
    void make(const std::vector<RowEdges>& edges, int y, int nb, int na, int begin, int end);
};

// What SliceView does with a row of voxels: sums over the image's rows in columns `from` .. from + n - 1, and back.
void rotated_reduce(const RotatedPanelRow& row, const float* slope, const float* curvature, int64_t stride, int terms,
                    int from, int n, float* out, int64_t pitch);
void rotated_expand(const RotatedPanelRow& row, const float* change, int64_t pitch, const float* curvature,
                    int64_t stride, int terms, int from, int n, float* slope);

// Rows of voxels this far apart share no pixel, nor does the work on one touch the other's.
int rotated_independent_step(const std::vector<RowEdges>& edges, int ny, int na);

} // namespace palpate
