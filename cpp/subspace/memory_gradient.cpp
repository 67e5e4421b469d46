#include "subspace/memory_gradient.h"
#include "base/cpu_dispatch.h"
#include "base/simd.h"
#include "base/thread_pool.h"
#include <algorithm>
#include <vector>

namespace palpate {
namespace {

constexpr int64_t block = 4096; // elements a partial sum: few enough for float lanes

// Partial sums of each block or row, added up in order.
template <int count, class Part> void summed(int64_t parts, double* total, const Part& part) {
    std::vector<double> sums(parts * count);
    parallel(parts, [&](int64_t begin, int64_t end, int) {
        for (int64_t k = begin; k < end; k++) part(k, &sums[k * count]);
    });
    std::fill_n(total, count, 0.0);
    for (int64_t k = 0; k < parts; k++)
        for (int i = 0; i < count; i++) total[i] += sums[k * count + i];
}

template <int count> PALPATE_INLINE void add_up(const float (&lane)[count][lanes], double weight, double* sums) {
    for (int i = 0; i < count; i++) {
        double sum = 0;
        for (int k = 0; k < lanes; k++) sum += lane[i][k];
        sums[i] += weight * sum;
    }
}

// A row of f, previous and u.
struct Row {
    const float *f, *previous, *u;
    Row at(int64_t i) const { return {f + i, previous + i, u + i}; }
};

// One step of the neighbourhood for a whole row: b is the neighbouring row, already shifted.
template <Potential potential>
PALPATE_INLINE void bend_row(const Row& a, const Row& b, int64_t count, const PotentialParameters& law, double weight,
                             double* sums) {
    f32x8 vector_sums[3] = {}; // explicit: the compiler does not find vectors where the curvature is constant
    int64_t x = 0;
    for (; x + lanes <= count; x += lanes) {
        f32x8 t, du, dp, other, bend;
        float difference[lanes], curvature[lanes];
        load(t, a.f + x);
        load(other, b.f + x);
        t -= other;
        load(du, a.u + x);
        load(other, b.u + x);
        du -= other;
        load(dp, a.previous + x);
        load(other, b.previous + x);
        dp = t - (dp - other);
        store(difference, t);
        for (int k = 0; k < lanes; k++) curvature[k] = potential_curvature<potential>(law, difference[k]);
        load(bend, curvature);
        const f32x8 bu = bend * du;
        vector_sums[0] += bu * du;
        vector_sums[1] += bu * dp;
        vector_sums[2] += bend * dp * dp;
    }
    float lane[3][lanes];
    for (int i = 0; i < 3; i++) store(lane[i], vector_sums[i]);
    for (; x < count; x++) {
        const float t = a.f[x] - b.f[x], bend = potential_curvature<potential>(law, t);
        const float du = a.u[x] - b.u[x], dp = t - (a.previous[x] - b.previous[x]);
        lane[0][0] += bend * du * du;
        lane[1][0] += bend * du * dp;
        lane[2][0] += bend * dp * dp;
    }
    add_up(lane, weight, sums);
}

PALPATE_KERNEL void bend_step(const PotentialParameters& law, const Row& a, const Row& b, int64_t count, double weight,
                              double* sums) {
    PALPATE_RETURN_FOR_POTENTIAL(law.potential, bend_row, a, b, count, law, weight, sums);
}

PALPATE_KERNEL void bend_pixels(const float* __restrict curvature, const float* __restrict l,
                                const float* __restrict previous, const float* __restrict q, int64_t size,
                                double* sums) {
    float lane[3][lanes] = {};
    int64_t i = 0;
    for (; i + lanes <= size; i += lanes)
        for (int k = 0; k < lanes; k++) {
            const float c = curvature[i + k], dq = q[i + k], ds = l[i + k] - previous[i + k];
            lane[0][k] += c * dq * dq;
            lane[1][k] += c * dq * ds;
            lane[2][k] += c * ds * ds;
        }
    for (; i < size; i++) {
        const float c = curvature[i], dq = q[i], ds = l[i] - previous[i];
        lane[0][0] += c * dq * dq;
        lane[1][0] += c * dq * ds;
        lane[2][0] += c * ds * ds;
    }
    add_up(lane, 1, sums);
}

PALPATE_KERNEL void advance_block(const float* __restrict f, const float* __restrict previous, float w0, float w1,
                                  int64_t begin, int64_t end, float* __restrict u) {
    for (int64_t i = begin; i < end; i++) u[i] = std::max(0.0f, f[i] + (w0 * u[i] + w1 * (f[i] - previous[i])));
}

int64_t blocks(int64_t size) { return (size + block - 1) / block; }

} // namespace

void prior_curvatures(const Neighbourhood& n, const float* f, const float* previous, const float* u, Slices slices,
                      double curvatures[3]) {
    summed<3>((slices.end - slices.first) * n.ny, curvatures, [&](int64_t part, double* sums) {
        const int64_t index = slices.first * n.ny + part, z = index / n.ny, y = index % n.ny;
        const Row row = Row{f, previous, u}.at(index * n.nx);
        for_each_forward_step(n, z, y, [&](int64_t first, int64_t there, int64_t count, double weight) {
            bend_step(n.law, row.at(first), row.at(there), count, weight, sums);
        });
        for_each_at_border(n, z, y, 0, n.nx, [&](int64_t x, double weight) {
            const double bend = weight * potential_curvature(n.law, row.f[x]), dp = double(row.f[x]) - row.previous[x];
            sums[0] -= bend * row.u[x] * row.u[x];
            sums[1] -= bend * row.u[x] * dp;
            sums[2] -= bend * dp * dp;
        });
    });
}

void data_curvatures(const float* curvature, const float* l, const float* previous, const float* q, int64_t size,
                     double curvatures[3]) {
    summed<3>(blocks(size), curvatures, [&](int64_t k, double* sums) {
        const int64_t i = k * block;
        bend_pixels(curvature + i, l + i, previous + i, q + i, std::min(block, size - i), sums);
    });
}

void advance(const float* f, const float* previous, const double w[2], int64_t size, float* u) {
    parallel(size, [&](int64_t begin, int64_t end, int) {
        advance_block(f, previous, float(w[0]), float(w[1]), begin, end, u);
    });
}

} // namespace palpate
