#pragma once
#include "geometry.h"

namespace palpate {

// What the voxels of one slice (or sub-slice) weigh along one axis of the parallel panel: the part of each pixel's
// width under the shadow of each voxel, averaged over the thickness (a trapezoid). The footprint of voxel (z, y, x) in
// a view is the sum over sub-slices of (along y)[y] x (along x)[x], through the resampling if there is one, times
// path[pixel].
//
// weight[t * n + i] belongs to the pair (i, first[i] + t); entries beyond the other axis are 0. Both directions hold
// the same numbers, so what uses one is the exact transpose of what uses the other.
struct AxisWeights {
    int taps = 0, n = 0;
    std::vector<int32_t> first;
    std::vector<float> weight;
};

// Scratch beyond the end of a row of either axis that first[i] + t may touch.
constexpr int tap_padding = 64;

enum class Axis { x, y };

// Per voxel along `axis`: the pixels that its shadow touches. sub: which sub-slice of slice z.
void by_voxel(const Geometry& geometry, const View& view, int z, int sub, Axis axis, AxisWeights& out);

// The same numbers per pixel: `count` is the number of pixels along the axis.
void by_pixel(const AxisWeights& voxels, int count, AxisWeights& out);

} // namespace palpate
