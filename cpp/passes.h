#pragma once
#include "lanes.h"
#include "spans.h"

namespace palpate {

constexpr int height = run, width = 32; // rows and columns of a tile
typedef int32_t Order __attribute__((vector_size(32)));

// How eight neighbouring results read the source: vector `first` (and the one after it) + tap, in `order`; or, where
// they reach further or the source ends, one by one.
struct Reach {
    enum { one, two, each } vectors;
    int first;
    Order order;

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

// The first pass: out[moment][row][result] = sum over taps of weight * source[row][first + tap], for `rows` rows of the
// source and eight results (of rows `width` long); weights as in Spans. gather_rows does any reach, one by one.
void resample_rows(const float* source, int64_t stride, int rows, const Reach& reach, int moments, const float* weight,
                   int taps, int64_t moment_size, float* out);
void gather_rows(const float* source, int64_t stride, int rows, const int32_t* first, int moments, const float* weight,
                 int taps, int64_t moment_size, float* out);

// The second pass: sum[row] += sum over moments and taps of weight * rows[moment][first[row] - begin + tap].
void add_rows(const float* rows, int64_t moment_size, const int32_t* first, const int32_t* own, int begin,
              const float* weight, int moments, int taps, int count, float* sum);

} // namespace palpate
