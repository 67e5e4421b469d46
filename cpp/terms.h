#pragma once
#include "weights.h"

namespace palpate {

constexpr int column_padding = 16; // floats beyond the last column of an image, so that whole vectors fit

// How the descent keeps a view. Where the rows of the image can follow the rows of the volume (and the columns x), a
// footprint is a sum of products of weights along the two, which leave out the length of the ray's path: the image
// holds it. Elsewhere (tilted panels, and panels turned about x) it is a list of measured pixels.
struct Layout {
    bool separable;
    int rows, columns;
    int64_t start, down, right; // measured pixel of (0, 0), and steps to the next row and column
    int64_t stride;             // floats from row to row

    explicit Layout(const View& view);
};

constexpr int pairs_of(int terms) { return terms * (terms + 1) / 2; }

// Pixels first[i] .. first[i] + count[i] - 1 that voxel i touches in some term; first is 0 where it touches none.
// Returns the largest count.
int extents(const std::vector<AxisWeights>& terms, std::vector<int32_t>& first, std::vector<int32_t>& count);

// Weights of the voxels of a slice along one axis of an image: a footprint is a sum over `terms` of (along y) x (along
// x). Voxel i touches pixels first[i] .. first[i] + count[i] - 1 in some term. Per voxel and pixel (`width` of them, 0
// beyond count) `stride()` numbers: the weight in each term, then the product of each pair of terms (m, m'), m <= m'.
struct AxisTerms {
    int terms = 0, width = 0;
    std::vector<int32_t> first, count;
    std::vector<float> weight;

    int stride() const { return terms + pairs_of(terms); }
    int
    apart(int spread) const; // voxels this far apart share no pixel, if each also touches the spread - 1 behind its own
    const float* of(int i) const { return &weight[size_t(i) * width * stride()]; }

    void make(const Geometry& geometry, const View& view, int z, Axis axis); // weights are those of by_voxel

private:
    std::vector<AxisWeights> parts;
    void lay_out();
};

} // namespace palpate
