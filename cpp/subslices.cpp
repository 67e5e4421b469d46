#include "subslices.h"
#include "weights.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int most = 16;        // sub-slices; times most_moments, the reference that fewer are judged by
constexpr int samples = 9;      // voxels at most along x and y, in 3 slices
constexpr double most_trim = 6; // tolerances: see cover

using Footprint = std::vector<double>; // over a window of pixels that holds it

// Evenly spread over n voxels.
std::vector<int> sample(int n) {
    std::vector<int> out(std::min(n, samples));
    for (size_t i = 0; i < out.size(); i++) out[i] = int((i + 0.5) * n / double(out.size()));
    return out;
}

// The axis tables of slice z at the sample voxels, one a product.
struct Cut {
    int subs;
    std::vector<AxisWeights> x, y;

    Cut(const Geometry& g, View v, int z, int subs, int moments) : subs(subs), x(subs * moments), y(subs * moments) {
        v.subs = subs;
        v.moments = moments;
        const Grid grid = g.seen_by(v);
        const std::vector<int> along_x = sample(grid.nx), along_y = sample(grid.ny);
        for (int product = 0; product < products(v); product++) {
            by_voxel(g, v, z, product, Axis::x, along_x, x[product]);
            by_voxel(g, v, z, product, Axis::y, along_y, y[product]);
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

// Sums over rows of sample voxels: footprints' error squared, squares, and values.
struct Tally {
    double error = 0, square = 0, value = 0;

    void add(const Cut& cut, const Cut& reference, int y) {
        for (int x = 0; x < cut.x[0].n; x++) {
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

constexpr int slices = 3; // first, middle and last

std::vector<Cut> cuts(const Geometry& g, const View& v, int subs, int moments) {
    std::vector<Cut> out;
    for (int z : {0, g.grid.nz / 2, g.grid.nz - 1}) out.emplace_back(g, v, z, subs, moments);
    return out;
}

double error(const Geometry& g, const std::vector<Cut>& tried, const std::vector<Cut>& reference) {
    Tally tally;
    for (int i = 0; i < slices; i++)
        for (int y = 0; y < tried[i].y[0].n; y++) tally.add(tried[i], reference[i], y);
    return tally.relative(g.grid.nz);
}

// As an endless panel would see it: what is chosen so is the same whatever part of the volume the panel sees.
View endless(View v) {
    const int margin = 1 << 16; // pixels
    v.left -= margin * v.pa;
    v.low -= margin * v.pb;
    v.na += 2 * margin;
    v.nb += 2 * margin;
    return v;
}

// The fewest products of sub-slices and moments that are within the tolerance.
void find_products(const Geometry& g, const View& bare, View& v) {
    const std::vector<Cut> reference = cuts(g, bare, most, most_moments);
    for (int count = 1; count <= most * most_moments; count++)
        for (v.moments = most_moments; v.moments >= 1; v.moments--) { // more moments err less than as many sub-slices
            v.subs = count / v.moments;
            if (count % v.moments != 0 || v.subs > most) continue;
            if (error(g, cuts(g, bare, v.subs, v.moments), reference) <= g.tolerance) return;
        }
    v.subs = most;
    v.moments = most_moments;
}

// The middle of the rows whose shadows move so little that the first m moments are within the tolerance, and half their
// width. The error grows with how far a row's shadow moves, that is with its distance from the row under the source;
// taken for a straight line through the steepest sample, also where it begins as a square (two moments of three).
void find_calm_rows(const Geometry& g, const View& wide, const Grid& grid, View& v) {
    v.still = (v.source[1] - grid.y0) / grid.dy;
    const std::vector<Cut> reference = cuts(g, wide, v.subs, v.moments);
    const std::vector<int> rows = sample(grid.ny);
    for (int m = 1; m < v.moments; m++) {
        const std::vector<Cut> fewer = cuts(g, wide, v.subs, m);
        double steepest = 0;
        for (size_t y = 0; y < rows.size(); y++) {
            Tally tally;
            for (int i = 0; i < slices; i++) tally.add(fewer[i], reference[i], int(y));
            steepest = std::max(steepest, tally.relative(g.grid.nz) / std::max(std::fabs(rows[y] - v.still), 1.0));
        }
        v.band[m] = std::max(v.band[m - 1], steepest > 0 ? g.tolerance / steepest : 0);
    }
}

// As much of the weights' ends as may go within the tolerance.
void find_trim(const Geometry& g, View wide, View& v) {
    const std::vector<Cut> reference = cuts(g, wide, most, most_moments);
    for (double share = most_trim; share >= 1; share /= 2) {
        wide.trim = share * g.tolerance;
        if (error(g, cuts(g, wide, v.subs, v.moments), reference) > g.tolerance) continue;
        v.trim = wide.trim;
        return;
    }
}

} // namespace

void cut(const Geometry& g, View& v) {
    const Grid grid = g.seen_by(v);
    Resampling kept = std::move(v.resampling);
    v.still = v.trim = 0;
    v.band = {};
    const View bare =
        v; // without the resampling, which the weights do not read; rows as on a turned panel's first column
    v.resampling = std::move(kept);
    find_products(g, bare, v);
    if (v.pose == Pose::turned) return;
    if (v.moments > 1) find_calm_rows(g, endless(bare), grid, v);
    find_trim(g, endless(bare), v);
}

} // namespace palpate
