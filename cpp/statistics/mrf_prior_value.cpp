#include "base/cpu_dispatch.h"
#include "base/simd.h"
#include "base/thread_pool.h"
#include "base/vector_math.h"
#include "statistics/mrf_prior.h"
#include <cmath>
#include <vector>

namespace palpate {
namespace {

constexpr int64_t factors = 4;     // of one product
constexpr float max_factor = 1e9f; // four such factors are still a float; beyond, the logarithm is negligible

// sum − log(1 + sum + cross), to 1e-7 of the sum's square where the sum is small, for then cross is of second order
// too. log(1+e) = k ln 2 + z − z² q(z), 1 + z from √½ to √2; q by interpolation at Chebyshev's points.
PALPATE_INLINE void excess(const f32x8& sum, const f32x8& cross, f32x8& out) {
    const f32x8 e = sum + cross, whole = 1 + e, lost = e - (whole - 1);
    i32x8 bits;
    std::memcpy(&bits, &whole, sizeof bits);
    const i32x8 k = (bits - 0x3f3504f3) >> 23, scale_bits = (127 - k) << 23;
    f32x8 scale, first, q = {};
    std::memcpy(&scale, &scale_bits, sizeof scale);
    const f32x8 z = (whole * scale - 1) + lost * scale;
    constexpr float of_q[] = {-0.067690241f, 0.11557288f,  -0.11812136f, 0.12420814f,  -0.14232318f,
                              0.16667537f,   -0.20001447f, 0.25000011f,  -0.33333323f, 0.5f};
    for (float c : of_q) q = q * z + c;
    choose(k == 0, -cross, sum - __builtin_convertvector(k, f32x8) * 0.69314718f - z, first);
    out = first + z * z * q;
}

// Multiplies by eight factors 1 + s, s = |a − b|/edge. What exceeds max_factor is added to `sums` directly.
PALPATE_INLINE void multiply(const float* a, const float* b, int64_t x, float inverse, f32x8& sum, f32x8& cross,
                             f32x8& sums) {
    f32x8 t, u, s, limited;
    load(t, a + x);
    load(u, b + x);
    magnitude(t - u, s);
    s *= inverse;
    choose(s < max_factor, s, f32x8{} + max_factor, limited);
    sums += s - limited;
    cross += (sum + cross) * limited;
    sum += limited;
}

// Σ ψ₁(s) over a row for Lange's potential, s = |a − b|/edge: Σ s − log(1+s), with one logarithm for `factors` factors;
// Π (1+s) = 1 + sum + cross.
PALPATE_KERNEL double sum_lange(const PotentialParameters& law, const float* a, const float* b, int64_t count) {
    const float inverse = 1 / law.edge;
    f32x8 sums = {};
    int64_t x = 0;
    for (; x + 2 * factors * lanes <= count; x += 2 * factors * lanes) { // two independent products
        f32x8 sum[2] = {}, cross[2] = {}, value[2];
        for (int64_t k = 0; k < factors; k++)
            for (int64_t i = 0; i < 2; i++) multiply(a, b, x + (2 * k + i) * lanes, inverse, sum[i], cross[i], sums);
        excess(sum[0], cross[0], value[0]);
        excess(sum[1], cross[1], value[1]);
        sums += value[0] + value[1];
    }
    for (; x + lanes <= count; x += lanes) {
        f32x8 sum = {}, cross = {}, value;
        multiply(a, b, x, inverse, sum, cross, sums);
        excess(sum, cross, value);
        sums += value;
    }
    if (x < count) {
        float first[lanes] = {}, second[lanes] = {};
        for (int64_t i = 0; i < count - x; i++) first[i] = a[x + i], second[i] = b[x + i];
        f32x8 sum = {}, cross = {}, value;
        multiply(first, second, 0, inverse, sum, cross, sums);
        excess(sum, cross, value);
        sums += value;
    }
    double total = 0;
    for (int i = 0; i < lanes; i++) total += double(sums[i]);
    return total;
}

// ψ₁(s) of the other potentials, s >= 0.
template <Potential potential> PALPATE_INLINE double value_at(const PotentialParameters& law, double s) {
    if constexpr (potential == Potential::huber) return s < 1 ? s * s / 2 : s - 0.5;
    if constexpr (potential == Potential::hyperbola) return s * s / (1 + std::sqrt(1 + s * s));
    if constexpr (potential == Potential::generalised)
        return s * s / 2 / (1 + double(fast_power(float(s) + 1e-30f, 2 - law.exponent)));
    if constexpr (potential == Potential::tabulated) {
        // From entry i on: ψ₁ = V + ∫ u (w + k (u − s_i)) du, u from s_i to s; d = s − s_i.
        const TablePosition at = table_position(float(s));
        const float w = law.table->weight[at.index];
        const int32_t octave = at.index >> PotentialTable::bits, part = at.index & (PotentialTable::steps - 1);
        const float unit = float_of((127 - PotentialTable::octaves + octave) << 23),
                    step = unit * (1.0f / PotentialTable::steps);
        const float start = unit + step * float(part), k = (law.table->weight[at.index + 1] - w) / step;
        const float d = float(s) - start, c = at.fraction * step; // c: d, but 0 below the table
        return double(law.table->value[at.index] + d * (start * w + d * (0.5f * w)) +
                      c * c * k * (0.5f * start + c * (1 / 3.0f)));
    }
    return s * s / 2;
}

template <Potential potential>
PALPATE_INLINE double sum_row(const PotentialParameters& given, const float* __restrict a, const float* __restrict b,
                              int64_t count) {
    const PotentialParameters law = given;
    double sums[lanes] = {}, total = 0, inverse = 1 / double(law.edge);
    int64_t x = 0;
    for (; x + lanes <= count; x += lanes)
        for (int i = 0; i < lanes; i++)
            sums[i] += value_at<potential>(law, std::abs(double(a[x + i]) - b[x + i]) * inverse);
    for (; x < count; x++) total += value_at<potential>(law, std::abs(double(a[x]) - b[x]) * inverse);
    for (int i = 0; i < lanes; i++) total += sums[i];
    return total;
}

PALPATE_KERNEL double sum_step(const PotentialParameters& law, const float* a, const float* b, int64_t count) {
    PALPATE_RETURN_FOR_POTENTIAL(law.potential, sum_row, law, a, b, count);
    return 0;
}

// Σ ω ψ over the 13 forward steps, from the voxels of one row.
double row_value(const Neighbourhood& n, const float* f, int64_t z, int64_t y) {
    const float* row = f + (z * n.ny + y) * n.nx;
    const auto sum = n.law.potential == Potential::lange ? sum_lange : sum_step;
    double total = 0;
    for_each_forward_step(n, z, y, [&](int64_t first, int64_t there, int64_t count, double weight) {
        total += weight * sum(n.law, row + first, row + there, count);
    });
    const float zero = 0;
    for_each_at_border(n, z, y, 0, n.nx,
                       [&](int64_t x, double weight) { total -= weight * sum(n.law, row + x, &zero, 1); });
    return total * n.law.edge * n.law.edge; // a quadratic one has edge 1: see neighbourhood()
}

} // namespace

double prior_value(const Neighbourhood& n, const float* f, Slices slices) {
    // one sum a row: the total does not depend on the number of threads
    std::vector<double> part((slices.end - slices.first) * n.ny);
    parallel(int64_t(part.size()), [&](int64_t begin, int64_t end, int) {
        for (int64_t row = begin; row < end; row++) part[row] = row_value(n, f, slices.first + row / n.ny, row % n.ny);
    });
    double total = 0;
    for (double value : part) total += value;
    return total;
}

} // namespace palpate
