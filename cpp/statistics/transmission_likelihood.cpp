#include "statistics/transmission_likelihood.h"
#include "base/cpu_dispatch.h"
#include "base/thread_pool.h"
#include "base/vector_math.h"
#include <algorithm>
#include <cmath>
#include <vector>

namespace palpate {
namespace {

constexpr int64_t block =
    4096; // pixels; sums are made block by block, so that they do not depend on the number of threads
constexpr int lanes = 8;

// For smaller l, the difference h(0) − h(l) + l h'(l) is lost in rounding. There the maximum curvature is used, which
// exceeds the optimal one by at most l/3, so that the parabola still lies above.
constexpr double min_l = 1e-3;

// h(l) of one pixel, m = b e^-l + r, all in double: at b = 2e5 and l = 1e-3 a float has no correct digit left.
struct Poisson {
    double y, b, r;

    PALPATE_INLINE double value(double l) const {
        const double m = b * fast_exp(-l) + r, positive = y > 0 ? y : 1;
        return m - y + (y > 0 ? y * fast_log(positive / m) : 0);
    }
    PALPATE_INLINE double slope(double l) const {
        const double primary = b * fast_exp(-l);
        return primary * (y / (primary + r) - 1);
    }
    // Both with one exponential.
    PALPATE_INLINE double value_and_slope(double l, double& slope) const {
        const double primary = b * fast_exp(-l), m = primary + r, positive = y > 0 ? y : 1, ratio = positive / m;
        slope = primary * ((y > 0 ? ratio : 0) - 1);
        return m - y + (y > 0 ? y * fast_log(ratio) : 0);
    }
    double precomputed() const { return y > r ? (y - r) * (y - r) / y : 0; }

    // h'' = b e^-l (1 − y r / m²) has its maximum over l >= 0 at l = 0, or is negative.
    double maximum() const {
        double m = b + r;
        return std::max(0.0, b * (1 - y * r / (m * m)));
    }
    double optimal(double l) const {
        if (l < min_l) return maximum();
        double lost = -b * std::expm1(-l), primary = b - lost, m = primary + r;
        if (m <= 0) return maximum();
        double gap = lost - y * std::log1p(lost / m) + l * primary * (y / m - 1); // h(0) − h(l) + l h'(l)
        return std::max(0.0, 2 * gap / (l * l));
    }
};

// h = (m − y)²/2m + ½ log m = m/2 − y + y²/2m + ½ log m: three terms with a parabola above each. The smallest parabola
// above their sum has no known closed form.
struct Gaussian {
    double y, b, r;

    PALPATE_INLINE double value(double l) const {
        const double m = b * fast_exp(-l) + r, positive = y > 0.5 ? y : 0.5;
        return (m - y) * (m - y) / (2 * m) + 0.5 * fast_log(m / positive);
    }
    PALPATE_INLINE double slope(double l) const {
        const double primary = b * fast_exp(-l), m = primary + r;
        return 0.5 * primary / m * ((y - m) * (y + m) / m - 1);
    }
    PALPATE_INLINE double value_and_slope(double l, double& slope) const {
        const double primary = b * fast_exp(-l), m = primary + r, positive = y > 0.5 ? y : 0.5, inverse = 1 / m;
        slope = 0.5 * primary * inverse * ((y - m) * (y + m) * inverse - 1);
        return 0.5 * ((y - m) * (y - m) * inverse + fast_log(m / positive));
    }
    double precomputed() const { return y > r ? (y - r) * ((y - r) + r / (2 * y)) / y : 0; }

    // Of ½ log m and y²/2m, whose second derivatives are ½ p r/m² and ½ y² p (p − r)/m³, p = b e^-l: the largest over
    // p <= b. The first peaks at p = r, the second at p = (2 + √3) r.
    double others() const {
        const double m = b + r, logarithm = b > r ? 0.125 : 0.5 * b * r / (m * m);
        const double peak = b > 3.732050808 * r ? 0.09622504486 / r : b > r ? b * (b - r) / (m * m * m) : 0;
        return logarithm + 0.5 * y * y * peak;
    }
    double maximum() const { return 0.5 * b + others(); }
    double optimal(double l) const { // the optimal one of m/2, which is that of y = 0
        if (l < min_l) return maximum();
        return std::max(0.0, -b * (std::expm1(-l) + l * std::exp(-l)) / (l * l)) + others();
    }
};

template <class Pixel> PALPATE_INLINE Pixel pixel(const Measurements& p, int64_t i) {
    return {p.counts[i], p.incident[i], p.background[i]};
}

// The pixel, or where it was not measured an ordinary one whose result the caller drops: no branch, and no NaN.
template <class Pixel> PALPATE_INLINE Pixel pixel_or_default(const Measurements& p, int64_t i) {
    const bool measured = p.incident[i] > 0;
    return {measured ? p.counts[i] : 1.0f, measured ? p.incident[i] : 1.0f, measured ? p.background[i] : 0.0f};
}

template <class Pixel>
PALPATE_INLINE double sum_values(const Measurements& given, const float* __restrict l, int64_t begin, int64_t end) {
    const Measurements p = given;
    double sums[lanes] = {}, total = 0;
    int64_t i = begin;
    for (; i + lanes <= end; i += lanes)
        for (int k = 0; k < lanes; k++) {
            const double value = pixel_or_default<Pixel>(p, i + k).value(l[i + k]);
            sums[k] += p.incident[i + k] > 0 ? value : 0;
        }
    for (; i < end; i++) total += p.incident[i] > 0 ? pixel<Pixel>(p, i).value(l[i]) : 0;
    for (double sum : sums) total += sum;
    return total;
}

template <class Pixel>
PALPATE_INLINE void slopes(const Measurements& given, const float* __restrict l, int64_t begin, int64_t end,
                           float* __restrict slope) {
    const Measurements p = given;
    for (int64_t i = begin; i < end; i++) {
        const double value = pixel_or_default<Pixel>(p, i).slope(l[i]);
        slope[i] = p.incident[i] > 0 ? float(value) : 0;
    }
}

PALPATE_KERNEL double sum_poisson(const Measurements& p, const float* l, int64_t begin, int64_t end) {
    return sum_values<Poisson>(p, l, begin, end);
}
PALPATE_KERNEL double sum_gaussian(const Measurements& p, const float* l, int64_t begin, int64_t end) {
    return sum_values<Gaussian>(p, l, begin, end);
}
PALPATE_KERNEL void slope_poisson(const Measurements& p, const float* l, int64_t begin, int64_t end, float* slope) {
    slopes<Poisson>(p, l, begin, end, slope);
}
PALPATE_KERNEL void slope_gaussian(const Measurements& p, const float* l, int64_t begin, int64_t end, float* slope) {
    slopes<Gaussian>(p, l, begin, end, slope);
}

template <class Pixel>
PALPATE_INLINE double values_and_slopes(const Measurements& given, const float* __restrict l, int64_t begin,
                                        int64_t end, float* __restrict slope) {
    const Measurements p = given;
    double sums[lanes] = {}, total = 0, at;
    int64_t i = begin;
    for (; i + lanes <= end; i += lanes)
        for (int k = 0; k < lanes; k++) {
            double derivative;
            const double value = pixel_or_default<Pixel>(p, i + k).value_and_slope(l[i + k], derivative);
            const bool measured = p.incident[i + k] > 0;
            sums[k] += measured ? value : 0;
            slope[i + k] = measured ? float(derivative) : 0;
        }
    for (; i < end; i++) {
        const double value = pixel_or_default<Pixel>(p, i).value_and_slope(l[i], at);
        total += p.incident[i] > 0 ? value : 0;
        slope[i] = p.incident[i] > 0 ? float(at) : 0;
    }
    for (double sum : sums) total += sum;
    return total;
}

PALPATE_KERNEL double value_and_slope_poisson(const Measurements& p, const float* l, int64_t begin, int64_t end,
                                              float* slope) {
    return values_and_slopes<Poisson>(p, l, begin, end, slope);
}
PALPATE_KERNEL double value_and_slope_gaussian(const Measurements& p, const float* l, int64_t begin, int64_t end,
                                               float* slope) {
    return values_and_slopes<Gaussian>(p, l, begin, end, slope);
}

template <class Pixel>
void curvatures(const Measurements& p, const float* l, Curvature kind, int64_t begin, int64_t end, float* c) {
    for (int64_t i = begin; i < end; i++) {
        const Pixel at = pixel<Pixel>(p, i);
        c[i] = !(p.incident[i] > 0)             ? 0
               : kind == Curvature::precomputed ? float(at.precomputed())
               : kind == Curvature::optimal     ? float(at.optimal(l[i]))
                                                : float(at.maximum());
    }
}

template <class Sum> double sum_of_blocks(int64_t size, const Sum& sum) {
    std::vector<double> part((size + block - 1) / block);
    parallel(int64_t(part.size()), [&](int64_t begin, int64_t end, int) {
        for (int64_t k = begin; k < end; k++) part[k] = sum(k * block, std::min(size, (k + 1) * block));
    });
    double total = 0;
    for (double value : part) total += value;
    return total;
}

} // namespace

double transmission_value(const Measurements& pixels, const float* l, Noise noise) {
    return sum_of_blocks(pixels.size, [&](int64_t begin, int64_t end) {
        return noise == Noise::poisson ? sum_poisson(pixels, l, begin, end) : sum_gaussian(pixels, l, begin, end);
    });
}

void transmission_slope(const Measurements& pixels, const float* l, Noise noise, float* slope) {
    parallel(pixels.size, [&](int64_t begin, int64_t end, int) {
        noise == Noise::poisson ? slope_poisson(pixels, l, begin, end, slope)
                                : slope_gaussian(pixels, l, begin, end, slope);
    });
}

double transmission_value_and_slope(const Measurements& pixels, const float* l, Noise noise, float* slope) {
    return sum_of_blocks(pixels.size, [&](int64_t begin, int64_t end) {
        return noise == Noise::poisson ? value_and_slope_poisson(pixels, l, begin, end, slope)
                                       : value_and_slope_gaussian(pixels, l, begin, end, slope);
    });
}

void transmission_curvature(const Measurements& pixels, const float* l, Noise noise, Curvature kind, float* curvature) {
    parallel(pixels.size, [&](int64_t begin, int64_t end, int) {
        noise == Noise::poisson ? curvatures<Poisson>(pixels, l, kind, begin, end, curvature)
                                : curvatures<Gaussian>(pixels, l, kind, begin, end, curvature);
    });
}

double least_squares_value(const float* weight, const float* p, const float* l, int64_t size) {
    return sum_of_blocks(size, [&](int64_t begin, int64_t end) {
        double sum = 0;
        for (int64_t i = begin; i < end; i++) sum += 0.5 * weight[i] * (double(l[i]) - p[i]) * (double(l[i]) - p[i]);
        return sum;
    });
}

} // namespace palpate
