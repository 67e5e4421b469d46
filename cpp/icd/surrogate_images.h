// The data term's paraboloidal surrogate as images (H. Erdogan & J. A. Fessler, IEEE Trans. Med. Imaging 18:801, 1999).
// Made by bindings/icd.cpp, read and changed by icd/coordinate_descent.cpp.
#pragma once
#include "base/huge_page_buffer.h"
#include "projection/scan_geometry.h"
#include <vector>

namespace palpate {

// Σ_i slope_i t + curvature_i t²/2 around the line integrals of the current volume. Per view, on the pixels on which
// its footprints are products (the parallel panel), or else on the measured ones; the length of each ray's path is
// folded in: slope · path and curvature · path². Made once and set anew for every sweep, because writing to newly
// allocated memory is slow.
class SurrogateImages {
public:
    const ScanGeometry& geometry;

    explicit SurrogateImages(const ScanGeometry& geometry);
    void set_slope(const float* slope) { set(slope, 0); } // (views, rows, columns)
    void set_curvature(const float* curvature) { set(curvature, 1); }
    float* slope(int view) { return images.data() + start[2 * view]; }
    const float* curvature(int view) const { return images.data() + start[2 * view + 1]; }

private:
    std::vector<int64_t> start;
    HugePageBuffer images;

    void set(const float* image, int which); // 0: slope, 1: curvature
};

} // namespace palpate
