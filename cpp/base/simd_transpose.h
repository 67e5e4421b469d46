// Transposition of up to 8 rows into SIMD lanes and back. Used by the coordinate descent, which updates 8 rows at once.
#pragma once
#include <cstdint>

namespace palpate {

// `count` <= 8 rows of n floats each; n vectors of 8 floats, one float of each row, `step` vectors apart.
// out[x * step * lanes + i] = rows[i][x]; rows from `count` on are 0.
void into_lanes(const float* const* rows, int count, int64_t n, float* out, int step = 1);
void out_of_lanes(const float* in, int count, int64_t n, float* const* rows, int step = 1);

} // namespace palpate
