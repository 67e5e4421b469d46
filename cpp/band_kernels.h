#pragma once
#include <cstdint>
#include <vector>

namespace palpate {

// What Bands does per eight voxels or columns: see Bands::look and Bands::spread, and its layout of weights.

constexpr int most_taps = 6, most_terms = 2; // of the kernels that are unrolled for them
constexpr int spread_terms = 3;              // up to so many are spread together, more one by one
constexpr int rows_at_once = 4;              // that read the weights together

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

// Rising voxels, unrolled. kernel: 10 · terms + taps. close: eight voxels touch sixteen columns at most.
void look_at(int kernel, bool close, const float* weight, const int32_t* first, int groups, const Looked& rows);

// Any others. lead: (bands) the first tap that a voxel shares with the one so far ahead. folded: what the columns say
// of pairs of terms is first weighed by the voxel itself, terms · terms products a tap, so that each voxel ahead takes
// one a term instead of one a pair; for 3 and 4 terms. scratch: rows_at_once · (terms + pairs) · taps vectors.
constexpr int least_folded = 3, most_folded = 4;
void look_along(Span span, int terms, int taps, bool folded, const std::vector<int32_t>& lead, const float* weight,
                const int32_t* first, int groups, const Looked& rows, float* scratch);

void spread_at(Span span, const float* weight, const int32_t* first, int terms, int taps, const float* change, int n,
               float* out, int64_t pitch);

} // namespace palpate
