#include "subslices.h"
#include "weights.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int most = 16;   // sub-slices; times most_moments, the reference that fewer are judged by
constexpr int samples = 9; // voxels along x and y, in 3 slices

using Footprint = std::vector<double>; // over a window of pixels that holds it

// The axis tables of slice z, one a product.
struct Cut {
    int subs;
    std::vector<AxisWeights> x, y;

    Cut(const Geometry& g, View v, int z, int subs, int moments) : subs(subs), x(subs * moments), y(subs * moments) {
        v.subs = subs;
        v.moments = moments;
        for (int product = 0; product < products(v); product++) {
            by_voxel(g, v, z, product, Axis::x, x[product]);
            by_voxel(g, v, z, product, Axis::y, y[product]);
        }
    }
};

struct Window {
    int low, size;
};

Window window(const std::vector<AxisWeights>& axis, int i) {
    int low = INT32_MAX, high = 0;
    for (const AxisWeights& w : axis) {
        low = std::min(low, int(w.first[i]));
        high = std::max(high, w.first[i] + w.taps);
    }
    return {low, high - low};
}

Footprint footprint(const Cut& cut, Window wy, Window wx, int y, int x) {
    Footprint out(size_t(wy.size) * wx.size, 0);
    const double part = 1.0 / cut.subs;
    for (size_t product = 0; product < cut.x.size(); product++) {
        const AxisWeights &ay = cut.y[product], &ax = cut.x[product];
        for (int t = 0; t < ay.taps; t++) {
            const int b = ay.first[y] + t - wy.low;
            const double w = part * ay.weight[size_t(t) * ay.n + y];
            if (w == 0 || b < 0 || b >= wy.size) continue;
            for (int u = 0; u < ax.taps; u++) {
                const int a = ax.first[x] + u - wx.low;
                if (a >= 0 && a < wx.size) out[size_t(b) * wx.size + a] += w * ax.weight[size_t(u) * ax.n + x];
            }
        }
    }
    return out;
}

// Sums over the sample voxels: footprints' error squared, squares, and values.
struct Tally {
    double error = 0, square = 0, value = 0;

    void add(const Cut& cut, const Cut& reference, const Grid& g) {
        for (int j = 0; j < samples; j++)
            for (int i = 0; i < samples; i++) {
                const int y = int((j + 0.5) * g.ny / samples), x = int((i + 0.5) * g.nx / samples);
                const Window wy = window(reference.y, y), wx = window(reference.x, x);
                const Footprint exact = footprint(reference, wy, wx, y, x), rough = footprint(cut, wy, wx, y, x);
                for (size_t p = 0; p < exact.size(); p++) {
                    error += (rough[p] - exact[p]) * (rough[p] - exact[p]);
                    square += exact[p] * exact[p];
                    value += exact[p];
                }
            }
    }
    // A ray sums nz slices of mean 1/2 and variance 1/12; a voxel's footprint adds up to its share of a pixel column.
    double relative(int nz) const {
        const double signal = value * nz / 4 + square / 12;
        return signal > 0 ? std::sqrt(error / 12 / signal) : 0;
    }
};

} // namespace

void cut(const Geometry& g, View& v) {
    const Grid grid = g.seen_by(v);
    Resampling kept = std::move(v.resampling);
    const View bare =
        v; // without the resampling, which the weights do not read; rows as on a turned panel's first column
    v.resampling = std::move(kept);
    const int moments = most_moments;
    const int slices[3] = {0, g.grid.nz / 2, g.grid.nz - 1};
    std::vector<Cut> reference;
    for (int z : slices) reference.emplace_back(g, bare, z, most, most_moments);
    for (int count = 1; count <= most * moments; count++)
        for (v.moments = moments; v.moments >= 1; v.moments--) { // more moments err less than as many sub-slices
            if (count % v.moments != 0) continue;
            v.subs = count / v.moments;
            if (v.subs > most) continue;
            Tally tally;
            for (int i = 0; i < 3; i++) tally.add(Cut(g, bare, slices[i], v.subs, v.moments), reference[i], grid);
            if (tally.relative(g.grid.nz) <= g.tolerance) return;
        }
    v.subs = most;
    v.moments = moments;
}

} // namespace palpate
