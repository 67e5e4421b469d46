#include "subslices.h"
#include "weights.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int most = 32;   // sub-slices, and the reference that fewer are judged by
constexpr int samples = 9; // voxels along x and y, in 3 slices

using Footprint = std::vector<double>; // over a window of pixels that holds it

// The axis tables of slice z cut into `subs`.
struct Cut {
    std::vector<AxisWeights> x, y;

    Cut(const Geometry& g, View v, int z, int subs) : x(subs), y(subs) {
        v.subs = subs;
        for (int sub = 0; sub < subs; sub++) {
            by_voxel(g, v, z, sub, Axis::x, x[sub]);
            by_voxel(g, v, z, sub, Axis::y, y[sub]);
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
    const double part = 1.0 / double(cut.x.size());
    for (size_t sub = 0; sub < cut.x.size(); sub++) {
        const AxisWeights &ay = cut.y[sub], &ax = cut.x[sub];
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

int sub_slices(const Geometry& g, const View& v) {
    const Grid grid = g.seen_by(v);
    View
        bare{}; // without the resampling, which the weights do not read; on a turned panel, rows as on its first column
    bare.source = v.source;
    bare.pose = v.pose, bare.swapped = v.swapped;
    bare.height = v.height, bare.run = v.run, bare.rise = v.rise;
    bare.pa = v.pa, bare.pb = v.pb, bare.left = v.left, bare.low = v.low;
    bare.na = v.na, bare.nb = v.nb;
    const int slices[3] = {0, g.grid.nz / 2, g.grid.nz - 1};
    std::vector<Cut> reference;
    for (int z : slices) reference.emplace_back(g, bare, z, most);
    for (int subs : {1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 24}) {
        Tally tally;
        for (int i = 0; i < 3; i++) tally.add(Cut(g, bare, slices[i], subs), reference[i], grid);
        if (tally.relative(g.grid.nz) <= g.tolerance) return subs;
    }
    return most;
}

} // namespace palpate
