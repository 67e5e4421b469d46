#include "statistics/mrf_prior.h"
#include "base/cpu_dispatch.h"
#include "base/thread_pool.h"
#include <algorithm>
#include <cmath>
#include <type_traits>
#include <vector>

namespace palpate {
namespace {

// The sums of slopes and curvatures of voxels.
struct Sums {
    float *gradient, *curvature;
    Sums from(int64_t x) const { return {gradient + x, curvature + x}; }
};

// add_row for a tabulated potential, in parts: the arithmetic becomes vector code, only the look-ups are scalar.
template <class Both>
PALPATE_INLINE void add_row_from_table(Both, const float* __restrict a, const float* __restrict b, int64_t count,
                                       float weight, const PotentialParameters& law, const Sums& of_a,
                                       const Sums& of_b) {
    constexpr int64_t part = 64;
    float t[part], share[part], low[part], high[part];
    int32_t index[part];
    const float inverse = 1 / law.edge, *table = law.table->weight;
    float* __restrict ga = of_a.gradient, * __restrict ca = of_a.curvature;
    float* __restrict gb = of_b.gradient, * __restrict cb = of_b.curvature;
    for (int64_t first = 0; first < count; first += part) {
        const int64_t n = std::min(part, count - first);
        for (int64_t x = 0; x < n; x++) {
            t[x] = a[first + x] - b[first + x];
            const TablePosition at = table_position(std::abs(t[x]) * inverse);
            index[x] = at.index;
            share[x] = at.fraction;
        }
        for (int64_t x = 0; x < n; x++) {
            low[x] = table[index[x]];
            high[x] = table[index[x] + 1];
        }
        for (int64_t x = 0; x < n; x++) {
            const float k = weight * (low[x] + share[x] * (high[x] - low[x])), slope = k * t[x];
            ga[first + x] += slope;
            ca[first + x] += k;
            if constexpr (Both::value) {
                gb[first + x] -= slope;
                cb[first + x] += k;
            }
        }
    }
}

// The pairs of row a with row b, which is shifted by the step along x. Adds to the sums of a and, for
// std::true_type, to those of b; they must then not overlap.
template <Potential potential, class Both>
PALPATE_INLINE void add_row(Both both, const float* __restrict a, const float* __restrict b, int64_t count,
                            float weight, const PotentialParameters& given, const Sums& of_a, const Sums& of_b) {
    if constexpr (potential == Potential::tabulated)
        return add_row_from_table(both, a, b, count, weight, given, of_a, of_b);
    const PotentialParameters law = given; // a copy: the compiler then knows that no store changes it
    float* __restrict ga = of_a.gradient, * __restrict ca = of_a.curvature;
    float* __restrict gb = of_b.gradient, * __restrict cb = of_b.curvature;
    for (int64_t x = 0; x < count; x++) {
        const float t = a[x] - b[x], k = weight * potential_curvature<potential>(law, t), slope = k * t;
        ga[x] += slope;
        ca[x] += k;
        if constexpr (Both::value) {
            gb[x] -= slope;
            cb[x] += k;
        }
    }
}

PALPATE_KERNEL void add_step(const PotentialParameters& law, const float* a, const float* b, int64_t count,
                             float weight, const Sums& of_a) {
    PALPATE_RETURN_FOR_POTENTIAL(law.potential, add_row, std::false_type(), a, b, count, weight, law, of_a, of_a);
}

PALPATE_KERNEL void add_both(const PotentialParameters& law, const float* a, const float* b, int64_t count,
                             float weight, const Sums& of_a, const Sums& of_b) {
    PALPATE_RETURN_FOR_POTENTIAL(law.potential, add_row, std::true_type(), a, b, count, weight, law, of_a, of_b);
}

// Adds the forward pairs of the voxels of one row to its own sums and to those of the rows after it. What belongs to
// slices before `first` or after `last` is added to `discarded`, so that the arithmetic is the same to the bit.
void add_forward(const Neighbourhood& n, const float* f, int64_t z, int64_t y, int64_t first, int64_t last,
                 const Sums& all, const Sums& discarded) {
    const int64_t here = (z * n.ny + y) * n.nx;
    const float* row = f + here;
    const Sums own = z >= first ? all.from(here) : discarded;
    for (int64_t dz = z >= first ? 0 : 1; dz <= 1; dz++)
        for (int64_t dy = dz == 0 ? 0 : -1; dy <= 1; dy++) {
            if (z + dz >= n.nz || y + dy < 0 || y + dy >= n.ny) continue;
            const int64_t there = here + (dz * n.ny + dy) * n.nx;
            const Sums other = z + dz <= last ? all.from(there) : discarded.from(n.nx);
            for (int64_t dx = -1; dx <= 1; dx++) {
                const float weight = n.weight[dz + 1][dy + 1][dx + 1];
                if (weight == 0) continue;
                const int64_t x = dx < 0 ? 1 : 0, count = n.nx - (dx != 0);
                const float *a = row + x, *b = f + there + x + dx;
                if (dz == 0 && dy == 0) // within the row each voxel sums both of its neighbours
                    add_step(n.law, a, b, count, weight, own.from(x));
                else
                    add_both(n.law, a, b, count, weight, own.from(x), other.from(x + dx));
            }
        }
}

// sums: of voxels begin .. end - 1 of the row.
void add_neighbours(const Neighbourhood& n, const float* f, int64_t z, int64_t y, int64_t begin, int64_t end,
                    const Sums& sums) {
    const float* row = f + (z * n.ny + y) * n.nx;
    for (int64_t dz = -1; dz <= 1; dz++)
        for (int64_t dy = -1; dy <= 1; dy++) {
            if (z + dz < 0 || z + dz >= n.nz || y + dy < 0 || y + dy >= n.ny) continue;
            if (dz == 0 && dy == 0) continue;
            const float* other = f + ((z + dz) * n.ny + y + dy) * n.nx;
            for (int64_t dx = -1; dx <= 1; dx++) {
                const float weight = n.weight[dz + 1][dy + 1][dx + 1];
                if (weight == 0) continue;
                const int64_t first = std::max<int64_t>(begin, -dx), last = std::min(end, n.nx - dx);
                add_step(n.law, row + first, other + first + dx, last - first, weight, sums.from(first - begin));
            }
        }
}

} // namespace

Neighbourhood neighbourhood(const int64_t shape[3], const double spacing[3], const PotentialParameters& law,
                            int neighbours) {
    Neighbourhood n{shape[0], shape[1], shape[2], {}, law, nullptr};
    if (law.potential == Potential::quadratic) n.law.edge = 1;
    const int most = neighbours == 6 ? 1 : neighbours == 18 ? 2 : 3; // coordinates in which neighbours may differ
    double volume = spacing[0] * spacing[1] * spacing[2];
    double smallest = std::min({spacing[0], spacing[1], spacing[2]});
    for (int dz = -1; dz <= 1; dz++)
        for (int dy = -1; dy <= 1; dy++)
            for (int dx = -1; dx <= 1; dx++) {
                double d = std::sqrt(std::pow(dz * spacing[0], 2) + std::pow(dy * spacing[1], 2) +
                                     std::pow(dx * spacing[2], 2));
                const bool near = d > 0 && (dz != 0) + (dy != 0) + (dx != 0) <= most;
                n.weight[dz + 1][dy + 1][dx + 1] = near ? float(volume / (d * smallest)) : 0;
            }
    return n;
}

void prior_surrogate(const Neighbourhood& n, const float* f, float* gradient, float* curvature) {
    const int64_t slice = n.ny * n.nx;
    parallel(n.nz, [&](int64_t begin, int64_t end, int) {
        if (begin == end) return;
        std::fill(gradient + begin * slice, gradient + end * slice, 0.0f);
        std::fill(curvature + begin * slice, curvature + end * slice, 0.0f);
        std::vector<float> rows(4 * n.nx);
        const Sums discarded{rows.data(), rows.data() + 2 * n.nx};
        // Each pair once. The slice before `begin` adds to this part only: every sum is in the order of the slices,
        // whatever the number of threads.
        for (int64_t z = std::max<int64_t>(0, begin - 1); z < end; z++)
            for (int64_t y = 0; y < n.ny; y++)
                add_forward(n, f, z, y, begin, end - 1, {gradient, curvature}, discarded);
        for (int64_t row = begin * n.ny; row < end * n.ny; row++) {
            const int64_t here = row * n.nx;
            leave_out_border(n, f + here, row / n.ny, row % n.ny, 0, n.nx, gradient + here, curvature + here);
        }
    });
}

void leave_out_border(const Neighbourhood& n, const float* row, int64_t z, int64_t y, int64_t begin, int64_t end,
                      float* slope, float* curvature) {
    for_each_at_border(n, z, y, begin, end, [&](int64_t x, float weight) {
        const float k = weight * potential_curvature(n.law, row[x]);
        slope[x - begin] -= k * row[x];
        curvature[x - begin] -= k;
    });
}

void prior_across_rows(const Neighbourhood& n, const float* f, int64_t z, int64_t y, int64_t begin, int64_t end,
                       float* gradient, float* curvature) {
    std::fill_n(gradient, end - begin, 0.0f);
    std::fill_n(curvature, end - begin, 0.0f);
    add_neighbours(n, f, z, y, begin, end, {gradient, curvature});
}

} // namespace palpate
