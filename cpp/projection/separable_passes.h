// The two passes of the separable projector: along x, then along y. Called by forward and back projection's tiles.
#pragma once
#include "base/simd.h"
#include "projection/tile_weights.h"

namespace palpate {

constexpr int tile_rows = tile_size, tile_columns = tile_size; // rows and columns of a tile
constexpr int rows_at_once = 4;                                // rows that the first pass resamples together

// Rows of floats that a pass reads: a slice, or a window of an image.
struct SourceRows {
    const float* values;
    int64_t stride;
    int columns;
};

// How eight neighbouring results read the source at each tap: one vector from first + tap on, shuffled by `order`;
// two such vectors; or one element at a time, where they reach further or the source ends.
struct ShufflePattern {
    enum { one, two, each } vectors;
    int first;
    int32_t order[lanes];

    ShufflePattern() = default;
    ShufflePattern(const int32_t* from, int taps, int columns) {
        for (int n : {1, 2}) {
            first = std::min(from[0], columns - n * lanes - (taps - 1));
            vectors = n == 1 ? one : two;
            if (first >= 0 && from[lanes - 1] - first < n * lanes) break;
            vectors = each;
        }
        for (int i = 0; i < lanes; i++) order[i] = from[i] - first;
    }
};

// The same for each sixteen columns of a tile, for the AVX-512 pass (separable_passes_avx512.h).
struct ShufflePattern16 {
    static constexpr int simd_width = 16, groups = tile_columns / simd_width;
    int first[groups];
    bool one[groups], fits[groups];
    bool nonempty[groups]; // whether any column has a weight
    int32_t order[tile_columns];

    void find(const TileWeights& columns, int columns_of_source);
};

// The weights along x of a tile, ready for the first pass. If the source is finer than the result, eight columns
// reach beyond one vector. The rows of the source are then stored deinterleaved: the even elements, and odd_offset
// after them the odd ones. The first (taps + 1) / 2 taps are those of the even elements, the others those of the odd
// ones.
struct ColumnWeights {
    TileWeights weights;
    int64_t odd_offset; // 0: not deinterleaved
    ShufflePattern reach[tile_columns / lanes];
    bool single_vector; // one vector suffices for every eight columns
    bool use_avx512;    // then `patterns16` is known
    ShufflePattern16 patterns16;
    void prepare(int columns_of_source, bool avx512);
    void prepare_deinterleaved(int columns_of_half, int64_t jump_to_odd);
    int taps_side_by_side() const { return odd_offset ? (weights.taps + 1) / 2 : weights.taps; }
    void find_patterns(); // sets `reach` and `single_vector`, once

private:
    AlignedBuffer deinterleaved;
    int limit; // columns of the source, or of its even elements
    bool patterns_known;
};

// A ring buffer of resampled rows, for all moments. Its size is a power of two.
struct RowBuffer {
    AlignedBuffer values;
    int size = 0;
    void prepare(int taps, int moments);
};

// Both passes of a sub-slice: sum[row][column] += sum over moments and taps of rows' weight x columns' weight x
// source, for as many moments as the rows have.
void add_subslice(const SourceRows& source, const TileWeights& rows, ColumnWeights& columns, RowBuffer& buffer,
                  float* sum);

} // namespace palpate
