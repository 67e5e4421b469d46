// Sixteen columns at a time. Each row of the source is resampled into registers; the rows of the tile that need it
// find it there, with those before it. The weights along x and the rows in use take up to thirty of the 32 AVX-512
// registers.
#include "projection/separable_passes_avx512.h"
#include <array>
#include <atomic>
#include <utility>

#ifdef PALPATE_AVX512

namespace palpate {
namespace {

std::atomic<bool> allowed{true};

constexpr int simd_width = ShufflePattern16::simd_width;
constexpr int prefetch_rows = 3; // of the source
typedef float Wide __attribute__((vector_size(4 * simd_width)));
typedef int32_t WideOrder __attribute__((vector_size(4 * simd_width)));

#define PALPATE_WIDE __attribute__((target("arch=x86-64-v4"), noinline))

PALPATE_INLINE void load(Wide& v, const float* p) { std::memcpy(&v, p, sizeof v); }
PALPATE_INLINE void load(WideOrder& v, const int32_t* p) { std::memcpy(&v, p, sizeof v); }
PALPATE_INLINE void store(float* p, const Wide& v) { std::memcpy(p, &v, sizeof v); }
#if defined(__clang__)
PALPATE_INLINE void permute(const Wide& x, const WideOrder& order, Wide& out) {
    out = _mm512_permutexvar_ps(__m512i(order), x);
}
PALPATE_INLINE void permute(const Wide& x, const Wide& y, const WideOrder& order, Wide& out) {
    out = _mm512_permutex2var_ps(x, __m512i(order), y);
}
#else
PALPATE_INLINE void permute(const Wide& x, const WideOrder& order, Wide& out) { out = __builtin_shuffle(x, order); }
PALPATE_INLINE void permute(const Wide& x, const Wide& y, const WideOrder& order, Wide& out) {
    out = __builtin_shuffle(x, y, order);
}
#endif

// Adds to `blocks` times sixteen columns, from column j of the tile on. A window of resampled rows stays in
// registers.
template <int blocks, int moments, int taps, int window, bool one>
PALPATE_INLINE void add_blocks(const float* source, int64_t stride, const ShufflePattern16& patterns16,
                               const TileWeights& columns, int j, const TileWeights& rows, int64_t prefetch_distance,
                               float* sum) {
    Wide weight[blocks][moments][taps];
    WideOrder order[blocks][one ? 1 : taps];
    const float* from[blocks];
    PALPATE_UNROLL
    for (int b = 0; b < blocks; b++) {
        PALPATE_UNROLL
        for (int m = 0; m < moments; m++) PALPATE_UNROLL_UP_TO(16)
        for (int t = 0; t < taps; t++)
            load(weight[b][m][t], &columns.weight[(m * taps + t) * tile_size + j + b * simd_width]);
        PALPATE_UNROLL_UP_TO(16)
        for (int t = 0; t < (one ? 1 : taps); t++)
            load(order[b][t], patterns16.order + j + b * simd_width), order[b][t] += t;
        from[b] = source + rows.begin * stride + patterns16.first[j / simd_width + b];
    }
    Wide row[blocks][window][moments] = {};
    const float* by = rows.weight.data();
    int next = rows.begin;
    for (int r = 0; r < rows.count; r++, by++) {
        if (rows.support[r] == 0) continue;
        for (; next < rows.first[r] + window; next++) PALPATE_UNROLL
        for (int b = 0; b < blocks; b++, from[b - 1] += stride) {
            PALPATE_UNROLL
            for (int k = 0; k + 1 < window; k++) PALPATE_UNROLL
            for (int m = 0; m < moments; m++) row[b][k][m] = row[b][k + 1][m];
            if (!one) __builtin_prefetch(from[b] + prefetch_rows * stride, 0, 3);
            __builtin_prefetch(from[b] + prefetch_rows * stride + simd_width, 0, 3);
            __builtin_prefetch(from[b] + prefetch_distance, 0, 2);
            Wide x[2];
            if (!one) {
                load(x[0], from[b]), load(x[1], from[b] + simd_width);
                asm("" : "+v"(x[0]), "+v"(x[1])); // keeps the compiler from loading them again for every tap
            }
            PALPATE_UNROLL_UP_TO(16)
            for (int t = 0; t < taps; t++) {
                Wide y;
                if (one) {
                    load(y, from[b] + t);
                    permute(y, order[b][0], y);
                } else {
                    permute(x[0], x[1], order[b][one ? 0 : t], y);
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
        for (int b = 0; b < blocks; b++) load(s[b], sum + r * tile_columns + b * simd_width);
        PALPATE_UNROLL
        for (int k = 0; k < window; k++) {
            if (k > 1 && rows.support[r] <= k) break; // the other weights are 0: mostly the last of three
            PALPATE_UNROLL
            for (int m = 0; m < moments; m++) {
                const float w = by[(m * window + k) * tile_size];
                PALPATE_UNROLL
                for (int b = 0; b < blocks; b++) s[b] += row[b][k][m] * w;
            }
        }
        PALPATE_UNROLL
        for (int b = 0; b < blocks; b++) store(sum + r * tile_columns + b * simd_width, s[b]);
    }
}

template <int moments, int taps, int window>
PALPATE_WIDE void add_tile(const SourceRows& source, const TileWeights& rows, const TileWeights& columns,
                           const ShufflePattern16& patterns16, int64_t prefetch_distance, float* sum) {
    constexpr int max_blocks = moments * taps <= 6 && moments * window <= 6 ? 2 : 1; // that fit into the registers
    const float* from = source.values;
    const int64_t stride = source.stride;
    for (int j = 0; j < columns.count;) {
        const int n = j / simd_width;
        if (!patterns16.nonempty[n]) {
            j += simd_width;
            continue;
        }
        const bool one = patterns16.one[n];
        const bool two = max_blocks == 2 && j + simd_width < columns.count && patterns16.nonempty[n + 1] &&
                         patterns16.one[n + 1] == one;
        if (two && one)
            add_blocks<max_blocks, moments, taps, window, true>(from, stride, patterns16, columns, j, rows,
                                                                prefetch_distance, sum + j);
        else if (two)
            add_blocks<max_blocks, moments, taps, window, false>(from, stride, patterns16, columns, j, rows,
                                                                 prefetch_distance, sum + j);
        else if (one)
            add_blocks<1, moments, taps, window, true>(from, stride, patterns16, columns, j, rows, prefetch_distance,
                                                       sum + j);
        else
            add_blocks<1, moments, taps, window, false>(from, stride, patterns16, columns, j, rows, prefetch_distance,
                                                        sum + j);
        j += two ? 2 * simd_width : simd_width;
    }
}

using Kernel = void (*)(const SourceRows&, const TileWeights&, const TileWeights&, const ShufflePattern16&, int64_t,
                        float*);

constexpr int least = 2, most_taps = 9, most_window = 5, windows = most_window - least + 1;
constexpr int tile_kinds = (most_taps - least + 1) * windows;

template <int moments, int... kind>
constexpr std::array<Kernel, tile_kinds> kernels(std::integer_sequence<int, kind...>) {
    return {add_tile<moments, least + kind / windows, least + kind % windows>...};
}
template <int moments> constexpr auto kernels_of = kernels<moments>(std::make_integer_sequence<int, tile_kinds>());

Kernel kernel_of(int moments, int taps, int window) {
    if (taps < least || taps > most_taps || window < least || window > most_window) return nullptr;
    const int kind = (taps - least) * windows + window - least;
    return moments == 1 ? kernels_of<1>[kind] : moments == 2 ? kernels_of<2>[kind] : kernels_of<3>[kind];
}

} // namespace

bool avx512_allowed() {
#ifdef PALPATE_VERSIONS
    static const bool there = __builtin_cpu_supports("x86-64-v4");
    return there && allowed;
#else // the whole module is for such a CPU
    return allowed;
#endif
}

void allow_avx512_passes(bool whether) { allowed = whether; }

bool add_subslice_avx512(const SourceRows& source, const TileWeights& rows, const ColumnWeights& columns,
                         int64_t prefetch_distance, float* sum) {
    if (!columns.use_avx512) return false;
    const Kernel kernel = kernel_of(rows.moments, columns.weights.taps, rows.taps);
    if (kernel) kernel(source, rows, columns.weights, columns.patterns16, prefetch_distance, sum);
    return kernel;
}

} // namespace palpate

#else

namespace palpate {
bool avx512_allowed() { return false; }
void allow_avx512_passes(bool) {}
bool add_subslice_avx512(const SourceRows&, const TileWeights&, const ColumnWeights&, int64_t, float*) { return false; }
} // namespace palpate

#endif
