#pragma once
#include <cstdint>

namespace palpate {

// What Bands does per eight voxels or columns: see Bands::look and Bands::spread, and its layout of weights.

constexpr int most_taps = 6, most_terms = 2; // of the unrolled kernels

// kernel: 10 · terms + taps, or 0 for any.
void look_at(int kernel, bool close, int terms, int taps, int bands, const float* weight, const int32_t* first,
             const float* sums, int64_t pitch, int groups, float* out, int64_t plane);

// vectors: 1 where eight columns touch eight voxels at most, 2 for sixteen, 0 for more.
void spread_at(int vectors, const float* weight, const int32_t* first, int terms, int taps, const float* change, int n,
               float* out, int64_t pitch);

} // namespace palpate
