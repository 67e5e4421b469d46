#include "prior.h"
#include "dispatch.h"
#include "parallel.h"
#include <algorithm>
#include <cmath>
#include <vector>

namespace palpate {
namespace {

// One step of the neighbourhood for a whole row: a is the row, b the neighbouring row already shifted by the step along
// x.
template <Potential potential>
PALPATE_INLINE void add_row(const float* __restrict a, const float* __restrict b, int64_t count, float weight,
                            float edge, float* __restrict gradient, float* __restrict curvature) {
    for (int64_t x = 0; x < count; x++) {
        float t = a[x] - b[x], k = weight * potential_curvature(potential, t, edge);
        gradient[x] += k * t;
        curvature[x] += k;
    }
}

PALPATE_KERNEL void add_step(Potential potential, const float* a, const float* b, int64_t count, float weight,
                             float edge, float* gradient, float* curvature) {
    switch (potential) {
    case Potential::quadratic:
        return add_row<Potential::quadratic>(a, b, count, weight, edge, gradient, curvature);
    case Potential::huber:
        return add_row<Potential::huber>(a, b, count, weight, edge, gradient, curvature);
    case Potential::lange:
        return add_row<Potential::lange>(a, b, count, weight, edge, gradient, curvature);
    }
}

// gradient, curvature: of voxels begin .. end - 1 of the row.
void add_neighbours(const Neighbourhood& n, const float* f, int64_t z, int64_t y, int64_t begin, int64_t end,
                    bool own_row, float* gradient, float* curvature) {
    const float* row = f + (z * n.ny + y) * n.nx;
    for (int64_t dz = -1; dz <= 1; dz++)
        for (int64_t dy = -1; dy <= 1; dy++) {
            if (z + dz < 0 || z + dz >= n.nz || y + dy < 0 || y + dy >= n.ny) continue;
            if (!own_row && dz == 0 && dy == 0) continue;
            const float* other = f + ((z + dz) * n.ny + y + dy) * n.nx;
            for (int64_t dx = -1; dx <= 1; dx++) {
                if (dz == 0 && dy == 0 && dx == 0) continue;
                const int64_t first = std::max<int64_t>(begin, -dx), last = std::min(end, n.nx - dx);
                add_step(n.potential, row + first, other + first + dx, last - first, n.weight[dz + 1][dy + 1][dx + 1],
                         n.edge, gradient + first - begin, curvature + first - begin);
            }
        }
}

constexpr int lanes = 8;
constexpr int64_t run = 16; // factors of one product: far from overflow in double

// Σ ψ(a − b) over a row. Lange: Σ s − log(1+s), s = |t|/δ, with one logarithm for `run` factors instead of one each.
PALPATE_KERNEL double sum_lange(const float* __restrict a, const float* __restrict b, int64_t count, double edge) {
    double sums[lanes] = {}, total = 0, inverse = 1 / edge;
    int64_t x = 0;
    while (x + lanes <= count) {
        double product[lanes] = {1, 1, 1, 1, 1, 1, 1, 1};
        for (int64_t k = 0; k < run && x + lanes <= count; k++, x += lanes)
            for (int i = 0; i < lanes; i++) {
                double s = std::abs(double(a[x + i]) - b[x + i]) * inverse;
                sums[i] += s;
                product[i] *= 1 + s;
            }
        for (int i = 0; i < lanes; i++) total -= std::log(product[i]);
    }
    for (int i = 0; i < lanes; i++) total += sums[i];
    for (; x < count; x++) {
        double s = std::abs(double(a[x]) - b[x]) * inverse;
        total += s - std::log1p(s);
    }
    return total * edge * edge;
}

PALPATE_KERNEL double sum_huber(const float* __restrict a, const float* __restrict b, int64_t count, double edge) {
    double total = 0;
    for (int64_t x = 0; x < count; x++) {
        double size = std::abs(double(a[x]) - b[x]), inner = std::min(size, edge);
        total += inner * (size - inner / 2); // t²/2 up to the edge, δ|t| − δ²/2 beyond; quadratic is an infinite edge
    }
    return total;
}

// Σ ω ψ over the 13 steps that lead forward, from the voxels of one row.
double row_value(const Neighbourhood& n, const float* f, int64_t z, int64_t y) {
    const float* row = f + (z * n.ny + y) * n.nx;
    double total = 0, edge = n.potential == Potential::quadratic ? HUGE_VAL : double(n.edge);
    for (int64_t dz = 0; dz <= 1; dz++)
        for (int64_t dy = -1; dy <= 1; dy++)
            for (int64_t dx = -1; dx <= 1; dx++) {
                if (dz * 9 + dy * 3 + dx <= 0) continue;
                if (z + dz >= n.nz || y + dy < 0 || y + dy >= n.ny) continue;
                const float* other = f + ((z + dz) * n.ny + y + dy) * n.nx;
                int64_t first = dx < 0 ? 1 : 0, count = n.nx - (dx != 0);
                auto sum = n.potential == Potential::lange ? sum_lange : sum_huber;
                total += n.weight[dz + 1][dy + 1][dx + 1] * sum(row + first, other + first + dx, count, edge);
            }
    return total;
}

} // namespace

Neighbourhood neighbourhood(const int64_t shape[3], const double spacing[3], Potential potential, double edge) {
    Neighbourhood n{shape[0], shape[1], shape[2], {}, potential, float(edge)};
    double volume = spacing[0] * spacing[1] * spacing[2];
    double smallest = std::min({spacing[0], spacing[1], spacing[2]});
    for (int dz = -1; dz <= 1; dz++)
        for (int dy = -1; dy <= 1; dy++)
            for (int dx = -1; dx <= 1; dx++) {
                double d = std::sqrt(std::pow(dz * spacing[0], 2) + std::pow(dy * spacing[1], 2) +
                                     std::pow(dx * spacing[2], 2));
                n.weight[dz + 1][dy + 1][dx + 1] = d > 0 ? float(volume / (d * smallest)) : 0;
            }
    return n;
}

double prior_value(const Neighbourhood& n, const float* f) {
    std::vector<double> part(n.nz * n.ny); // a sum a row: the total does not depend on the number of threads
    parallel(n.nz * n.ny, [&](int64_t begin, int64_t end, int) {
        for (int64_t row = begin; row < end; row++) part[row] = row_value(n, f, row / n.ny, row % n.ny);
    });
    double total = 0;
    for (double value : part) total += value;
    return total;
}

void prior_surrogate(const Neighbourhood& n, const float* f, float* gradient, float* curvature) {
    parallel(n.nz * n.ny, [&](int64_t begin, int64_t end, int) {
        std::fill(gradient + begin * n.nx, gradient + end * n.nx, 0.0f);
        std::fill(curvature + begin * n.nx, curvature + end * n.nx, 0.0f);
        for (int64_t row = begin; row < end; row++)
            add_neighbours(n, f, row / n.ny, row % n.ny, 0, n.nx, true, gradient + row * n.nx, curvature + row * n.nx);
    });
}

void prior_across_rows(const Neighbourhood& n, const float* f, int64_t z, int64_t y, int64_t begin, int64_t end,
                       float* gradient, float* curvature) {
    std::fill_n(gradient, end - begin, 0.0f);
    std::fill_n(curvature, end - begin, 0.0f);
    add_neighbours(n, f, z, y, begin, end, false, gradient, curvature);
}

} // namespace palpate
