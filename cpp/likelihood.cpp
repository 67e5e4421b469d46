#include "likelihood.h"
#include "parallel.h"
#include <algorithm>
#include <cmath>
#include <vector>

namespace palpate {
namespace {

constexpr int64_t block = 4096; // sums are made block by block, so that they do not depend on the number of threads

// Below this the difference h(0) − h(l) + l h'(l) is lost in rounding; the maximum curvature, which exceeds the optimal
// one by l/3 at most there, stands in for it: the parabola stays above.
constexpr double small = 1e-3;

// h(l) = m − y log m, m = b e^-l + r, everything of one pixel in double: at b = 2e5, l = 1e-3 float has no digit left.
struct Pixel {
    double y, b, r;

    double value(double l) const {
        double m = b * std::exp(-l) + r;
        return m - y + (y > 0 ? y * std::log(y / m) : 0);
    }
    double slope(double l) const {
        double primary = b * std::exp(-l), m = primary + r;
        return m > 0 ? primary * (y / m - 1) : 0;
    }
    double precomputed() const { return y > r ? (y - r) * (y - r) / y : 0; }

    // h'' = b e^-l (1 − y r / m²) is largest over l >= 0 at l = 0, or negative everywhere it is not.
    double maximum() const {
        double m = b + r;
        return std::max(0.0, b * (1 - y * r / (m * m)));
    }
    double optimal(double l) const {
        if (l < small) return maximum();
        double lost = -b * std::expm1(-l), primary = b - lost, m = primary + r;
        if (m <= 0) return maximum();
        double gap = lost - y * std::log1p(lost / m) + l * primary * (y / m - 1); // h(0) − h(l) + l h'(l)
        return std::max(0.0, 2 * gap / (l * l));
    }
    double curvature(double l, Curvature kind) const {
        if (kind == Curvature::precomputed) return precomputed();
        return kind == Curvature::optimal ? optimal(l) : maximum();
    }
};

Pixel pixel(const Counts& p, int64_t i) { return {p.counts[i], p.incident[i], p.background[i]}; }

template <class Sum> double blockwise(int64_t size, const Sum& sum) {
    std::vector<double> part((size + block - 1) / block);
    parallel(int64_t(part.size()), [&](int64_t begin, int64_t end, int) {
        for (int64_t k = begin; k < end; k++) part[k] = sum(k * block, std::min(size, (k + 1) * block));
    });
    double total = 0;
    for (double value : part) total += value;
    return total;
}

} // namespace

double transmission_value(const Counts& pixels, const float* l) {
    return blockwise(pixels.size, [&](int64_t begin, int64_t end) {
        double sum = 0;
        for (int64_t i = begin; i < end; i++)
            if (pixels.incident[i] > 0) sum += pixel(pixels, i).value(l[i]);
        return sum;
    });
}

void transmission_slope(const Counts& pixels, const float* l, float* slope) {
    parallel(pixels.size, [&](int64_t begin, int64_t end, int) {
        for (int64_t i = begin; i < end; i++)
            slope[i] = pixels.incident[i] > 0 ? float(pixel(pixels, i).slope(l[i])) : 0;
    });
}

void transmission_curvature(const Counts& pixels, const float* l, Curvature kind, float* curvature) {
    parallel(pixels.size, [&](int64_t begin, int64_t end, int) {
        for (int64_t i = begin; i < end; i++)
            curvature[i] = pixels.incident[i] > 0 ? float(pixel(pixels, i).curvature(l[i], kind)) : 0;
    });
}

double least_squares_value(const float* weight, const float* p, const float* l, int64_t size) {
    return blockwise(size, [&](int64_t begin, int64_t end) {
        double sum = 0;
        for (int64_t i = begin; i < end; i++) sum += 0.5 * weight[i] * (double(l[i]) - p[i]) * (double(l[i]) - p[i]);
        return sum;
    });
}

} // namespace palpate
