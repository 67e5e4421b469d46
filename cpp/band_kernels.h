#pragma once
#include <cstdint>
#include <vector>

namespace palpate {

// What Bands does per eight voxels or columns: see Bands::look and Bands::spread, and its layout of weights.

constexpr int most_taps = 6, most_terms = 2; // of the kernels, which are unrolled for them

// How far eight neighbours reach: within eight of the first, within sixteen, or further.
enum class Span { near, wide, any };

// The sums of some rows, `row` floats apart, `pitch` from term to term; and their planes, as far apart as said.
struct Looked {
    const float* sums;
    int64_t row, pitch;
    float* out;
    int64_t out_row, plane;
    int rows;
};

// kernel: 10 · terms + taps. close: eight voxels touch sixteen columns at most.
void look_at(int kernel, bool close, const float* weight, const int32_t* first, int groups, const Looked& rows);

// terms: 1 or 2.
void spread_at(Span span, const float* weight, const int32_t* first, int terms, int taps, const float* change, int n,
               float* out, int64_t pitch);

} // namespace palpate
