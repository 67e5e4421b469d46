#pragma once
#include <cstdint>

namespace palpate {

// `count` <= lanes rows of n floats each, and the same n vectors of a float a row, `step` vectors apart.

// out[x * step * lanes + i] = rows[i][x]; absent rows are 0.
void into_lanes(const float* const* rows, int count, int64_t n, float* out, int step = 1);
void out_of_lanes(const float* in, int count, int64_t n, float* const* rows, int step = 1);

} // namespace palpate
