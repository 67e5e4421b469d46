// Resampling of a parallel image onto the pixels of an oblique panel, and its transpose, as sparse matrices.
// Made with the geometry; applied by the projector, in parallel over rows of the matrix.
#pragma once
#include <cstdint>
#include <vector>

namespace palpate {

// A sparse matrix by rows: row i has the entries offset[i] .. offset[i + 1] - 1.
struct SparseRows {
    std::vector<int64_t> offset;
    std::vector<int32_t> index;
    std::vector<float> weight;
};

// The mean of a fine image over quadrilaterals: the measured pixels, projected onto the parallel panel from the focal
// spot. The matrix is kept by rows and by columns, so that in both directions a thread owns what it writes.
struct Resampling {
    SparseRows measured; // for each measured pixel, the fine pixels and the part of it that each covers
    SparseRows fine;     // the transpose
    int fine_count = 0;
};

// corners: (rows + 1, columns + 1, 2) positions (a, b) of the measured pixels' corners, in fine pixels (fine pixel 0
// is centred at 0). The fine image has na columns and nb rows; what falls outside it is lost.
Resampling resampling(int rows, int columns, const std::vector<double>& corners, int na, int nb);

// out[i] = sum of weight * in[index] over row i.
void apply(const SparseRows& rows, const float* in, float* out);

} // namespace palpate
