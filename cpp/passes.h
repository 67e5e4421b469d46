#pragma once
#include "lanes.h"
#include "spans.h"

namespace palpate {

constexpr int height = run, width = run; // rows and columns of a tile
constexpr int group = 4;                 // rows that the first pass resamples together

// Rows of numbers.
struct Source {
    const float* values;
    int64_t stride;
    int columns;
};

// How eight neighbouring results read the source: vector `first` (and the one after it) + tap, in `order`; or, where
// they reach further or the source ends, one by one.
struct Reach {
    enum { one, two, each } vectors;
    int first;
    int32_t order[lanes];

    Reach() = default;
    Reach(const int32_t* from, int taps, int columns) {
        for (int n : {1, 2}) {
            first = std::min(from[0], columns - n * lanes - (taps - 1));
            vectors = n == 1 ? one : two;
            if (first >= 0 && from[lanes - 1] - first < n * lanes) break;
            vectors = each;
        }
        for (int i = 0; i < lanes; i++) order[i] = from[i] - first;
    }
};

// How each sixteen columns of a tile read the source, where a row of it may stay in registers (sliding.h): from `first`
// on, in `order`; all within one vector from each tap on, or within two.
struct Gathering {
    static constexpr int wide = 16, groups = width / wide;
    int first[groups];
    bool one[groups], fits[groups];
    bool reached[groups]; // whether one of them has any weight
    int32_t order[width];

    void find(const Spans& columns, int columns_of_source);
};

// The columns of a tile, ready for the first pass. Where the source is finer than they, eight of them reach beyond one
// vector; its rows are then stored `halved`: the even elements, and `jump` after them the odd ones. Of each half they
// reach half as far: the first (taps + 1) / 2 taps are those of the even half, the others those of the odd one.
struct ColumnSpans {
    Spans spans;
    int64_t jump; // 0: not halved
    Reach reach[width / lanes];
    bool plain;     // every eight are within one vector's reach
    bool may_slide; // then `gathering` is known
    Gathering gathering;
    void prepare(int columns_of_source);
    void prepare_halved(int columns_of_half, int64_t jump_to_odd);        // takes spans over, of the whole source
    int near() const { return jump ? (spans.taps + 1) / 2 : spans.taps; } // taps side by side
    void see(); // finds reach and plain, where somebody asks for them

private:
    Buffer halves;
    int limit; // columns of the source, or of a half
    bool seen;
};

// Rows that the second pass may ask for at once, of all moments: `size` of them, a power of two, turn by turn.
struct RowRing {
    Buffer values;
    int size = 0;
    void prepare(int taps, int moments);
};

// Both passes of a sub-slice: sum[row][column] += sum over moments and taps of rows' weight x columns' weight x source.
// Of as many moments as the rows have. ahead: from a number that is read to one that is needed from memory soon,
// floats.
void add_slice(const Source& source, const Spans& rows, ColumnSpans& columns, RowRing& ring, int64_t ahead, float* sum);

} // namespace palpate
