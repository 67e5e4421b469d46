// The two passes of the separable projector for short sums, sixteen columns at a time. A row of the source is resampled
// into registers; the rows of the tile that need it, one after the other, find it there with those before it. Weights
// along x, and the rows in use, take up to thirty of the thirty-two registers that AVX-512 has: with sixteen of half
// the width there is no room for that.
#include "sliding.h"
#include <array>
#include <atomic>
#include <utility>

#ifdef PALPATE_VERSIONS

namespace palpate {
namespace {

std::atomic<bool> allowed{true};

constexpr int wide = Gathering::wide;
constexpr int soon = 3; // rows to call for in advance
typedef float Wide __attribute__((vector_size(4 * wide)));
typedef int32_t WideOrder __attribute__((vector_size(4 * wide)));

#define PALPATE_WIDE __attribute__((target("arch=x86-64-v4"), noinline))
#define PALPATE_UNROLL_LONG _Pragma("GCC unroll 16")

PALPATE_INLINE void load(Wide& v, const float* p) { std::memcpy(&v, p, sizeof v); }
PALPATE_INLINE void load(WideOrder& v, const int32_t* p) { std::memcpy(&v, p, sizeof v); }
PALPATE_INLINE void store(float* p, const Wide& v) { std::memcpy(p, &v, sizeof v); }

// `blocks` times sixteen columns, from column j of the tile on.
template <int blocks, int moments, int taps, int window, bool one>
PALPATE_INLINE void slide_blocks(const float* source, int64_t stride, const Gathering& gathering, const Spans& columns,
                                 int j, const Spans& rows, int64_t ahead, float* sum) {
    Wide weight[blocks][moments][taps];
    WideOrder order[blocks][one ? 1 : taps];
    const float* from[blocks];
    PALPATE_UNROLL
    for (int b = 0; b < blocks; b++) {
        PALPATE_UNROLL
        for (int m = 0; m < moments; m++) PALPATE_UNROLL_LONG
        for (int t = 0; t < taps; t++) load(weight[b][m][t], &columns.weight[(m * taps + t) * run + j + b * wide]);
        PALPATE_UNROLL_LONG
        for (int t = 0; t < (one ? 1 : taps); t++) load(order[b][t], gathering.order + j + b * wide), order[b][t] += t;
        from[b] = source + rows.begin * stride + gathering.first[j / wide + b];
    }
    Wide row[blocks][window][moments] = {};
    const float* by = rows.weight.data();
    int next = rows.begin;
    for (int r = 0; r < rows.count; r++, by++) {
        if (rows.own[r] == 0) continue;
        for (; next < rows.first[r] + window; next++) PALPATE_UNROLL
        for (int b = 0; b < blocks; b++, from[b - 1] += stride) {
            PALPATE_UNROLL
            for (int k = 0; k + 1 < window; k++) PALPATE_UNROLL
            for (int m = 0; m < moments; m++) row[b][k][m] = row[b][k + 1][m];
            if (!one) __builtin_prefetch(from[b] + soon * stride, 0, 3);
            __builtin_prefetch(from[b] + soon * stride + wide, 0, 3);
            __builtin_prefetch(from[b] + ahead, 0, 2);
            Wide x[2];
            if (!one) {
                load(x[0], from[b]), load(x[1], from[b] + wide);
                asm("" : "+v"(x[0]), "+v"(x[1])); // else they are loaded again for every tap
            }
            PALPATE_UNROLL_LONG
            for (int t = 0; t < taps; t++) {
                Wide y;
                if (one) {
                    load(y, from[b] + t);
                    y = __builtin_shuffle(y, order[b][0]);
                } else {
                    y = __builtin_shuffle(x[0], x[1], order[b][one ? 0 : t]);
                }
                PALPATE_UNROLL
                for (int m = 0; m < moments; m++)
                    if (t == 0)
                        row[b][window - 1][m] = y * weight[b][m][t];
                    else
                        row[b][window - 1][m] += y * weight[b][m][t];
            }
        }
        Wide s[blocks];
        PALPATE_UNROLL
        for (int b = 0; b < blocks; b++) load(s[b], sum + r * width + b * wide);
        PALPATE_UNROLL
        for (int k = 0; k < window; k++) {
            if (k > 1 && rows.own[r] <= k) break; // the rest weighs nothing: mostly the last of three
            PALPATE_UNROLL
            for (int m = 0; m < moments; m++) {
                const float w = by[(m * window + k) * run];
                PALPATE_UNROLL
                for (int b = 0; b < blocks; b++) s[b] += row[b][k][m] * w;
            }
        }
        PALPATE_UNROLL
        for (int b = 0; b < blocks; b++) store(sum + r * width + b * wide, s[b]);
    }
}

template <int moments, int taps, int window>
PALPATE_WIDE void slide_tile(const Source& source, const Spans& rows, const Spans& columns, const Gathering& gathering,
                             int64_t ahead, float* sum) {
    constexpr int most = moments * taps <= 6 && moments * window <= 6 ? 2 : 1; // blocks that the registers hold
    const float* from = source.values;
    const int64_t stride = source.stride;
    for (int j = 0; j < columns.count;) {
        const int n = j / wide;
        if (!gathering.reached[n]) {
            j += wide;
            continue;
        }
        const bool one = gathering.one[n];
        const bool two =
            most == 2 && j + wide < columns.count && gathering.reached[n + 1] && gathering.one[n + 1] == one;
        if (two && one)
            slide_blocks<most, moments, taps, window, true>(from, stride, gathering, columns, j, rows, ahead, sum + j);
        else if (two)
            slide_blocks<most, moments, taps, window, false>(from, stride, gathering, columns, j, rows, ahead, sum + j);
        else if (one)
            slide_blocks<1, moments, taps, window, true>(from, stride, gathering, columns, j, rows, ahead, sum + j);
        else
            slide_blocks<1, moments, taps, window, false>(from, stride, gathering, columns, j, rows, ahead, sum + j);
        j += two ? 2 * wide : wide;
    }
}

using Kernel = void (*)(const Source&, const Spans&, const Spans&, const Gathering&, int64_t, float*);

constexpr int least = 2, most_taps = 9, most_window = 5, windows = most_window - least + 1;
constexpr int tile_kinds = (most_taps - least + 1) * windows;

template <int moments, int... kind>
constexpr std::array<Kernel, tile_kinds> kernels(std::integer_sequence<int, kind...>) {
    return {slide_tile<moments, least + kind / windows, least + kind % windows>...};
}
template <int moments> constexpr auto kernels_of = kernels<moments>(std::make_integer_sequence<int, tile_kinds>());

Kernel kernel_of(int moments, int taps, int window) {
    if (taps < least || taps > most_taps || window < least || window > most_window) return nullptr;
    const int kind = (taps - least) * windows + window - least;
    return moments == 1 ? kernels_of<1>[kind] : moments == 2 ? kernels_of<2>[kind] : kernels_of<3>[kind];
}

} // namespace

bool slides() {
    static const bool there = __builtin_cpu_supports("x86-64-v4");
    return there && allowed;
}

void allow_sliding(bool whether) { allowed = whether; }

bool slide_slice(const Source& source, const Spans& rows, const ColumnSpans& columns, int64_t ahead, float* sum) {
    if (!columns.may_slide) return false;
    const Kernel kernel = kernel_of(rows.moments, columns.spans.taps, rows.taps);
    if (kernel) kernel(source, rows, columns.spans, columns.gathering, ahead, sum);
    return kernel;
}

} // namespace palpate

#else

namespace palpate {
bool slides() { return false; }
void allow_sliding(bool) {}
bool slide_slice(const Source&, const Spans&, const ColumnSpans&, int64_t, float*) { return false; }
} // namespace palpate

#endif
