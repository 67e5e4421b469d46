// Trilinear interpolation of a volume on another grid. Called by palpate.volumes.
#pragma once
#include <cstdint>

namespace palpate {

// The new positions along one axis: position i lies between samples at[i] and at[i] + 1 of the `old` ones, at the
// fraction share[i] between them (0 if there is only one sample). weight[i] is 1 inside the volume, 0 outside.
struct InterpolationPoints {
    const int32_t* at;
    const float *share, *weight;
    int64_t old, count;
};

// Trilinear interpolation: out (z.count, y.count, x.count) of values (z.old, y.old, x.old). In parallel over rows.
void interpolate(const float* values, const InterpolationPoints& z, const InterpolationPoints& y,
                 const InterpolationPoints& x, float* out);

} // namespace palpate
