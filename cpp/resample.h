#pragma once
#include <cstdint>
#include <vector>

namespace palpate {

// Rows of (index, weight) pairs: row i holds entries offset[i] to offset[i + 1].
struct Sparse {
    std::vector<int64_t> offset;
    std::vector<int32_t> index;
    std::vector<float> weight;
};

// The mean of a fine image over each of some quadrilaterals: a measured pixel seen on the parallel panel through the
// focal spot. Both ways are kept, so that a thread owns what it writes either way and the two are exact transposes.
struct Resampling {
    Sparse measured; // per measured pixel: fine pixels and the part of the quadrilateral that each covers
    Sparse fine;     // the transpose
    int fine_count = 0;
};

// corners: (rows + 1, columns + 1, 2) positions (a, b), in units of fine pixels (centre of fine pixel 0 at 0), of the
// measured pixels' corners. The fine image has na columns and nb rows; what falls outside it is lost.
Resampling resampling(int rows, int columns, const std::vector<double>& corners, int na, int nb);

// out[i] = sum of weight * in[index] over row i.
void apply(const Sparse& rows, const float* in, float* out);

} // namespace palpate
