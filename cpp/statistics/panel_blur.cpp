#include "statistics/panel_blur.h"
#include "base/cpu_dispatch.h"
#include "base/thread_pool.h"
#include "base/vector_math.h"
#include <algorithm>
#include <vector>

namespace palpate {
namespace {

constexpr float darkest = 1e-30f; // of e^-l: a pixel behind lead still has a mean above 0

PALPATE_KERNEL void scale_row(float weight, const float* __restrict in, int64_t n, float* __restrict out) {
    for (int64_t i = 0; i < n; i++) out[i] = weight * in[i];
}

PALPATE_KERNEL void add_row(float weight, const float* __restrict in, int64_t n, float* __restrict out) {
    for (int64_t i = 0; i < n; i++) out[i] += weight * in[i];
}

// taps: (reach + 1); in: n values with `reach` zeros before and after them.
PALPATE_KERNEL void along_row(const float* __restrict taps, int64_t reach, const float* __restrict in, int64_t n,
                              float* __restrict out) {
    for (int64_t i = 0; i < n; i++) out[i] = taps[0] * in[i];
    for (int64_t k = 1; k <= reach; k++)
        for (int64_t i = 0; i < n; i++) out[i] += taps[k] * (in[i - k] + in[i + k]);
}

PALPATE_KERNEL void multiply_row(const float* __restrict factor, int64_t n, float* __restrict out) {
    for (int64_t i = 0; i < n; i++) out[i] *= factor[i];
}

PALPATE_KERNEL void divide_row(const float* __restrict by, int64_t n, float* __restrict out) {
    for (int64_t i = 0; i < n; i++) out[i] /= by[i];
}

PALPATE_KERNEL void exponential(const float* __restrict l, int64_t n, float* __restrict out) {
    for (int64_t i = 0; i < n; i++) {
        const auto e = float(fast_exp(-double(l[i])));
        out[i] = e < darkest ? darkest : e;
    }
}

// The sum of h over a row; `light`, K e^-l, becomes b (y/m − 1).
PALPATE_KERNEL double value_of_row(const float* __restrict y, const float* __restrict b, const float* __restrict r,
                                   int64_t n, float* __restrict light) {
    constexpr int lanes = 8;
    double sums[lanes] = {}, total = 0;
    for (int64_t first = 0; first < n; first += lanes) {
        const int64_t count = std::min<int64_t>(lanes, n - first);
        for (int64_t k = 0; k < count; k++) {
            const int64_t i = first + k;
            const bool measured = b[i] > 0;
            const double count_here = measured ? y[i] : 1, beam = measured ? b[i] : 1;
            const double m = beam * light[i] + (measured ? r[i] : 0);
            const double positive = count_here > 0 ? count_here : 1, ratio = positive / m;
            const double value = m - count_here + (count_here > 0 ? count_here * fast_log(ratio) : 0);
            sums[k] += measured ? value : 0;
            light[i] = measured ? float(beam * ((count_here > 0 ? ratio : 0) - 1)) : 0;
        }
    }
    for (double sum : sums) total += sum;
    return total;
}

// K of one view; row(i, values) then gets each row of the result while it is in the cache.
template <class Row> void blur_view(const PanelBlur& blur, int64_t view, const float* in, float* out, const Row& row) {
    const int64_t rows = blur.rows, columns = blur.columns, reach = blur.reach;
    const float* across = blur.taps + view * 2 * (reach + 1);
    parallel(rows, [&](int64_t begin, int64_t end, int) {
        std::vector<float> padded(columns + 2 * reach);
        float* middle = padded.data() + reach;
        for (int64_t i = begin; i < end; i++) {
            scale_row(across[0], in + i * columns, columns, middle);
            for (int64_t k = 1; k <= reach; k++) {
                if (i - k >= 0) add_row(across[k], in + (i - k) * columns, columns, middle);
                if (i + k < rows) add_row(across[k], in + (i + k) * columns, columns, middle);
            }
            along_row(across + reach + 1, reach, middle, columns, out + i * columns);
            row(i, out + i * columns);
        }
    });
}

void exponentials(const float* l, int64_t size, float* out) {
    parallel(size, [&](int64_t begin, int64_t end, int) { exponential(l + begin, end - begin, out + begin); });
}

} // namespace

void blur_views(const PanelBlur& blur, const float* in, float* out) {
    const int64_t size = blur.rows * blur.columns;
    for (int64_t view = 0; view < blur.views; view++)
        blur_view(blur, view, in + view * size, out + view * size, [](int64_t, float*) {});
}

double blurred_value(const Measurements& pixels, const PanelBlur& blur, const float* l, float* slope) {
    const int64_t columns = blur.columns, size = blur.rows * columns;
    std::vector<float> passed(size), light(size);
    std::vector<double> values(blur.views * blur.rows); // of rows, so that the sum does not depend on the threads
    for (int64_t view = 0; view < blur.views; view++) {
        const int64_t at = view * size;
        exponentials(l + at, size, passed.data());
        blur_view(blur, view, passed.data(), light.data(), [&](int64_t row, float* here) {
            const int64_t i = at + row * columns;
            values[view * blur.rows + row] =
                value_of_row(pixels.counts + i, pixels.incident + i, pixels.background + i, columns, here);
        });
        if (slope)
            blur_view(blur, view, light.data(), slope + at,
                      [&](int64_t row, float* here) { multiply_row(passed.data() + row * columns, columns, here); });
    }
    double total = 0;
    for (double value : values) total += value;
    return total;
}

void blurred_direction(const PanelBlur& blur, const float* l, const float* v, float* out) {
    const int64_t columns = blur.columns, size = blur.rows * columns;
    std::vector<float> passed(size), light(size);
    for (int64_t view = 0; view < blur.views; view++) {
        const int64_t at = view * size;
        exponentials(l + at, size, passed.data());
        blur_view(blur, view, passed.data(), light.data(), [](int64_t, float*) {});
        parallel(size, [&](int64_t begin, int64_t end, int) {
            multiply_row(v + at + begin, end - begin, passed.data() + begin);
        });
        blur_view(blur, view, passed.data(), out + at,
                  [&](int64_t row, float* here) { divide_row(light.data() + row * columns, columns, here); });
    }
}

} // namespace palpate
