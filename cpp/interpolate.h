#pragma once
#include <cstdint>

namespace palpate {

// Where the new positions along an axis lie among the old: between old[at] and old[at + 1], `share` of the way (0 where
// there is but one); weight is 0 where a position lies outside, else 1.
struct Positions {
    const int32_t* at;
    const float *share, *weight;
    int64_t old, count;
};

// Linear along each axis: out[z][y][x], the counts of the three axes, of values of their old sizes.
void interpolate(const float* values, const Positions& z, const Positions& y, const Positions& x, float* out);

} // namespace palpate
