#pragma once
#include "dispatch.h"
#include "geometry.h"
#include <algorithm>
#include <cmath>

namespace palpate {

// Antiderivative of t -> clamp(t, 0, 1).
PALPATE_INLINE double rise(double t) {
    const double c = std::min(std::max(t, 0.0), 1.0);
    return 0.5 * c * c + std::max(t - 1, 0.0);
}

// Mean over p from p1 to p2 of clamp(p - q, 0, 1): the part of the pixel [q, q + 1] left of an edge that moves from p1
// to p2 while the ray crosses the sub-slice.
PALPATE_INLINE double covered(double p1, double p2, double q) {
    const double move = p2 - p1, still = std::min(std::max(0.5 * (p1 + p2) - q, 0.0), 1.0);
    return std::fabs(move) < 1e-6 ? still : (rise(p2 - q) - rise(p1 - q)) / move;
}

// What the voxels of one slice (or sub-slice) weigh along one axis of a view's image: the part of each pixel's width
// under the shadow of each voxel, averaged over the thickness (a trapezoid). The footprint of voxel (z, y, x) in a view
// is the sum over sub-slices of (along y)[y] x (along x)[x], through the resampling if the panel is tilted, times
// path[pixel]. On a turned panel the weights along y differ by column: see Rows. x and y are those that the view sees
// (View::swapped).
//
// weight[t * n + i] belongs to the pair (i, first[i] + t); entries beyond the other axis are 0. Both directions hold
// the same numbers, so what uses one is the exact transpose of what uses the other.
struct AxisWeights {
    int taps = 0, n = 0;
    std::vector<int32_t> first;
    std::vector<float> weight;
};

enum class Axis { x, y };

// Per voxel along `axis`: the pixels that its shadow touches. sub: which sub-slice of slice z.
void by_voxel(const Geometry& geometry, const View& view, int z, int sub, Axis axis, AxisWeights& out);

// The same numbers per pixel: `count` is the number of pixels along the axis.
void by_pixel(const AxisWeights& voxels, int count, AxisWeights& out);

// Along y on a turned panel: the edge below voxel y lands on row at1.slope * y + at1.offset of column a when the ray is
// at the bottom of the sub-slice, and likewise at2 at its top; the weight of pixel (b, a) in voxel y is covered(edge y
// + 1) - covered(edge y) at q = b - 0.5.
struct Rows {
    std::vector<double> slope1, offset1, slope2, offset2; // per column
    int taps = 0;                                         // most pixels under one voxel
    int voxels = 0;                                       // most voxels over one pixel
};
void rows(const Geometry& geometry, const View& view, int z, int sub, Rows& out);

} // namespace palpate
