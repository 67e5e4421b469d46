#include "prior.h"
#include "dispatch.h"
#include "elementary.h"
#include "parallel.h"
#include <algorithm>
#include <cmath>
#include <vector>

namespace palpate {
namespace {

// Where the slopes and curvatures of a row's voxels are summed.
struct Sums {
    float *gradient, *curvature;
    Sums from(int64_t x) const { return {gradient + x, curvature + x}; }
};

// One step of the neighbourhood for a whole row: a is the row, b the neighbouring row already shifted by the step along
// x. Adds to the sums of a and, where `both`, of b, which must not overlap then.
template <Potential potential, bool both>
PALPATE_INLINE void add_row(const float* __restrict a, const float* __restrict b, int64_t count, float weight,
                            const Law& given, const Sums& of_a, const Sums& of_b) {
    const Law law = given; // its own copy: nothing written can change it
    float* __restrict ga = of_a.gradient, * __restrict ca = of_a.curvature;
    float* __restrict gb = of_b.gradient, * __restrict cb = of_b.curvature;
    for (int64_t x = 0; x < count; x++) {
        const float t = a[x] - b[x], k = weight * potential_curvature<potential>(law, t), slope = k * t;
        ga[x] += slope;
        ca[x] += k;
        if constexpr (both) {
            gb[x] -= slope;
            cb[x] += k;
        }
    }
}

// The same from a table, in parts: what is arithmetic becomes vector code, only the look-ups between go one by one.
template <bool both>
PALPATE_INLINE void add_row_from_table(const float* __restrict a, const float* __restrict b, int64_t count,
                                       float weight, const Law& law, const Sums& of_a, const Sums& of_b) {
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
            const Place at = place(std::abs(t[x]) * inverse);
            index[x] = at.index;
            share[x] = at.share;
        }
        for (int64_t x = 0; x < n; x++) {
            low[x] = table[index[x]];
            high[x] = table[index[x] + 1];
        }
        for (int64_t x = 0; x < n; x++) {
            const float k = weight * (low[x] + share[x] * (high[x] - low[x])), slope = k * t[x];
            ga[first + x] += slope;
            ca[first + x] += k;
            if constexpr (both) {
                gb[first + x] -= slope;
                cb[first + x] += k;
            }
        }
    }
}

template <bool both>
PALPATE_INLINE void add_any(const Law& law, const float* a, const float* b, int64_t count, float weight,
                            const Sums& of_a, const Sums& of_b) {
    switch (law.potential) {
    case Potential::quadratic:
        return add_row<Potential::quadratic, both>(a, b, count, weight, law, of_a, of_b);
    case Potential::huber:
        return add_row<Potential::huber, both>(a, b, count, weight, law, of_a, of_b);
    case Potential::lange:
        return add_row<Potential::lange, both>(a, b, count, weight, law, of_a, of_b);
    case Potential::hyperbola:
        return add_row<Potential::hyperbola, both>(a, b, count, weight, law, of_a, of_b);
    case Potential::generalised:
        return add_row<Potential::generalised, both>(a, b, count, weight, law, of_a, of_b);
    case Potential::tabulated:
        return add_row_from_table<both>(a, b, count, weight, law, of_a, of_b);
    }
}

PALPATE_KERNEL void add_step(const Law& law, const float* a, const float* b, int64_t count, float weight,
                             const Sums& of_a) {
    add_any<false>(law, a, b, count, weight, of_a, of_a);
}

PALPATE_KERNEL void add_both(const Law& law, const float* a, const float* b, int64_t count, float weight,
                             const Sums& of_a, const Sums& of_b) {
    add_any<true>(law, a, b, count, weight, of_a, of_b);
}

// The pairs that lead forward from the voxels of one row, to its own sums and to those of the rows ahead. What belongs
// to slices before `first` or after `last` goes to `spare` instead: the same arithmetic, to the last bit, as where it
// counts.
void add_forward(const Neighbourhood& n, const float* f, int64_t z, int64_t y, int64_t first, int64_t last,
                 const Sums& all, const Sums& spare) {
    const int64_t here = (z * n.ny + y) * n.nx;
    const float* row = f + here;
    const Sums own = z >= first ? all.from(here) : spare;
    for (int64_t dz = z >= first ? 0 : 1; dz <= 1; dz++)
        for (int64_t dy = dz == 0 ? 0 : -1; dy <= 1; dy++) {
            if (z + dz >= n.nz || y + dy < 0 || y + dy >= n.ny) continue;
            const int64_t there = here + (dz * n.ny + dy) * n.nx;
            const Sums other = z + dz <= last ? all.from(there) : spare.from(n.nx);
            for (int64_t dx = -1; dx <= 1; dx++) {
                const float weight = n.weight[dz + 1][dy + 1][dx + 1];
                if (weight == 0) continue;
                const int64_t x = dx < 0 ? 1 : 0, count = n.nx - (dx != 0);
                const float *a = row + x, *b = f + there + x + dx;
                if (dz == 0 && dy == 0) // the row itself: each voxel sums both of its neighbours
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

constexpr int lanes = 8;
constexpr int64_t run = 16; // factors of one product: far from overflow in double

// Σ ψ₁(s) over a row. Lange: Σ s − log(1+s) with one logarithm for `run` factors instead of one each.
PALPATE_KERNEL double sum_lange(const Law& law, const float* __restrict a, const float* __restrict b, int64_t count) {
    double sums[lanes] = {}, total = 0, inverse = 1 / double(law.edge);
    int64_t x = 0;
    while (x + lanes <= count) {
        double product[lanes] = {1, 1, 1, 1, 1, 1, 1, 1};
        for (int64_t k = 0; k < run && x + lanes <= count; k++, x += lanes)
            for (int i = 0; i < lanes; i++) {
                double s = std::abs(double(a[x + i]) - b[x + i]) * inverse;
                sums[i] += s;
                product[i] *= 1 + s;
            }
        for (int i = 0; i < lanes; i++) sums[i] -= fast_log(product[i]);
    }
    for (int i = 0; i < lanes; i++) total += sums[i];
    double product = 1;
    for (; x < count; x++) {
        double s = std::abs(double(a[x]) - b[x]) * inverse;
        total += s;
        product *= 1 + s;
    }
    return total - fast_log(product);
}

// ψ₁(s) of the others, s >= 0.
template <Potential potential> PALPATE_INLINE double value_at(const Law& law, double s) {
    if constexpr (potential == Potential::huber) return s < 1 ? s * s / 2 : s - 0.5;
    if constexpr (potential == Potential::hyperbola) return s * s / (1 + std::sqrt(1 + s * s));
    if constexpr (potential == Potential::generalised)
        return s * s / 2 / (1 + double(fast_power(float(s) + 1e-30f, 2 - law.exponent)));
    if constexpr (potential == Potential::tabulated) {
        // From entry i on: ψ₁ = V + ∫ u (w + k (u − s_i)) du, u from s_i to s; d = s − s_i.
        const Place at = place(float(s));
        const float w = law.table->weight[at.index];
        const int32_t octave = at.index >> Table::bits, part = at.index & (Table::steps - 1);
        const float unit = float_of((127 - Table::octaves + octave) << 23), step = unit * (1.0f / Table::steps);
        const float start = unit + step * float(part), k = (law.table->weight[at.index + 1] - w) / step;
        const float d = float(s) - start, c = at.share * step; // c: d, but 0 below the table
        return double(law.table->value[at.index] + d * (start * w + d * (0.5f * w)) +
                      c * c * k * (0.5f * start + c * (1 / 3.0f)));
    }
    return s * s / 2;
}

template <Potential potential>
PALPATE_INLINE double sum_row(const Law& given, const float* __restrict a, const float* __restrict b, int64_t count) {
    const Law law = given;
    double sums[lanes] = {}, total = 0, inverse = 1 / double(law.edge);
    int64_t x = 0;
    for (; x + lanes <= count; x += lanes)
        for (int i = 0; i < lanes; i++)
            sums[i] += value_at<potential>(law, std::abs(double(a[x + i]) - b[x + i]) * inverse);
    for (; x < count; x++) total += value_at<potential>(law, std::abs(double(a[x]) - b[x]) * inverse);
    for (int i = 0; i < lanes; i++) total += sums[i];
    return total;
}

PALPATE_KERNEL double sum_step(const Law& law, const float* a, const float* b, int64_t count) {
    switch (law.potential) {
    case Potential::huber:
        return sum_row<Potential::huber>(law, a, b, count);
    case Potential::hyperbola:
        return sum_row<Potential::hyperbola>(law, a, b, count);
    case Potential::generalised:
        return sum_row<Potential::generalised>(law, a, b, count);
    case Potential::tabulated:
        return sum_row<Potential::tabulated>(law, a, b, count);
    default:
        return sum_row<Potential::quadratic>(law, a, b, count);
    }
}

// Σ ω ψ over the 13 steps that lead forward, from the voxels of one row.
double row_value(const Neighbourhood& n, const float* f, int64_t z, int64_t y) {
    const float* row = f + (z * n.ny + y) * n.nx;
    const auto sum = n.law.potential == Potential::lange ? sum_lange : sum_step;
    double total = 0;
    for (int64_t dz = 0; dz <= 1; dz++)
        for (int64_t dy = -1; dy <= 1; dy++)
            for (int64_t dx = -1; dx <= 1; dx++) {
                if (dz * 9 + dy * 3 + dx <= 0) continue;
                if (z + dz >= n.nz || y + dy < 0 || y + dy >= n.ny) continue;
                const float* other = f + ((z + dz) * n.ny + y + dy) * n.nx;
                const double weight = n.weight[dz + 1][dy + 1][dx + 1];
                if (weight == 0) continue;
                int64_t first = dx < 0 ? 1 : 0, count = n.nx - (dx != 0);
                total += weight * sum(n.law, row + first, other + first + dx, count);
            }
    return total * n.law.edge * n.law.edge; // a quadratic one has edge 1: see neighbourhood()
}

} // namespace

Neighbourhood neighbourhood(const int64_t shape[3], const double spacing[3], const Law& law, int neighbours) {
    Neighbourhood n{shape[0], shape[1], shape[2], {}, law};
    if (law.potential == Potential::quadratic) n.law.edge = 1;
    const int most = neighbours == 6 ? 1 : neighbours == 18 ? 2 : 3; // coordinates that may differ
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
    const int64_t slice = n.ny * n.nx;
    parallel(n.nz, [&](int64_t begin, int64_t end, int) {
        if (begin == end) return;
        std::fill(gradient + begin * slice, gradient + end * slice, 0.0f);
        std::fill(curvature + begin * slice, curvature + end * slice, 0.0f);
        std::vector<float> rows(4 * n.nx);
        const Sums spare{rows.data(), rows.data() + 2 * n.nx};
        // Each pair once. The slice before gives to this part only: every sum is made in the order of the slices,
        // however they are shared out.
        for (int64_t z = std::max<int64_t>(0, begin - 1); z < end; z++)
            for (int64_t y = 0; y < n.ny; y++) add_forward(n, f, z, y, begin, end - 1, {gradient, curvature}, spare);
    });
}

void prior_across_rows(const Neighbourhood& n, const float* f, int64_t z, int64_t y, int64_t begin, int64_t end,
                       float* gradient, float* curvature) {
    std::fill_n(gradient, end - begin, 0.0f);
    std::fill_n(curvature, end - begin, 0.0f);
    add_neighbours(n, f, z, y, begin, end, {gradient, curvature});
}

} // namespace palpate
