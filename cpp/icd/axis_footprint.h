// Weights of the voxels of one slice along one axis of a view's image (separable footprints: Y. Long, J. A. Fessler &
// J. M. Balter, IEEE Trans. Med. Imaging 29:1839, 2010). Made by SliceView for each slice, read by all threads.
#pragma once
#include "projection/footprint_weights.h"

namespace palpate {

constexpr int pairs_of(int terms) { return terms * (terms + 1) / 2; }

// A footprint is a sum over `terms` of (weight along y) x (weight along x). Voxel i touches pixels first[i] ..
// first[i] + count[i] - 1 in some term; first is 0 where it touches none. Per voxel and pixel (`width` of them, 0
// beyond count) `stride()` numbers: the weight in each term, then the product of each pair of terms (m, m'), m <= m'.
struct AxisFootprint {
    int terms = 0, width = 0;
    std::vector<int32_t> first, count;
    std::vector<float> weight;

    int stride() const { return terms + pairs_of(terms); }
    const float* of(int voxel) const { return &weight[size_t(voxel) * width * stride()]; }
    // Voxels so far apart share no pixel, if each also touches the extra_pixels behind its own.
    int independent_step(int extra_pixels) const;

    void make(const ScanGeometry& geometry, const View& view, int z, Axis axis); // weights are those of voxel_weights

private:
    std::vector<AxisWeights> parts;
    int find_extents();
    void set_weights();
};

} // namespace palpate
