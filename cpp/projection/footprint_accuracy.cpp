#include "projection/footprint_accuracy.h"
#include "base/thread_pool.h"
#include "projection/footprint_weights.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int max_subslices = 16;    // sub-slices; times max_moments, the reference that fewer are judged by
constexpr int max_samples = 9;       // voxels at most along x and y, in 3 slices
constexpr double max_truncation = 6; // tolerances

using Footprint = std::vector<double>; // over a window of pixels that holds it

// Sample voxels, evenly spread over n.
std::vector<int> sample_voxels(int n) {
    std::vector<int> out(std::min(n, max_samples));
    for (size_t i = 0; i < out.size(); i++) out[i] = int((i + 0.5) * n / double(out.size()));
    return out;
}

// The 1-D weights of slice z at the sample voxels, one table for each product.
struct SampledWeights {
    int subslices;
    std::vector<AxisWeights> x, y;

    SampledWeights(const ScanGeometry& g, View v, int z, int subslices, int moments)
        : subslices(subslices), x(subslices * moments), y(subslices * moments) {
        v.subslices = subslices;
        v.moments = moments;
        const Grid grid = g.seen_by(v);
        const std::vector<int> along_x = sample_voxels(grid.nx), along_y = sample_voxels(grid.ny);
        for (int product = 0; product < products(v); product++) {
            voxel_weights(g, v, z, product, Axis::x, along_x, x[product]);
            voxel_weights(g, v, z, product, Axis::y, along_y, y[product]);
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

Footprint footprint(const SampledWeights& tried, Window wy, Window wx, int y, int x) {
    Footprint out(size_t(wy.size) * wx.size, 0);
    const double part = 1.0 / tried.subslices;
    for (size_t product = 0; product < tried.x.size(); product++) {
        const AxisWeights &ay = tried.y[product], &ax = tried.x[product];
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

// Sums over rows of sample voxels: squared errors of the footprints, their squares, and their values.
struct FootprintError {
    double error = 0, square = 0, value = 0;

    void add(const SampledWeights& tried, const SampledWeights& reference, int y) {
        for (int x = 0; x < tried.x[0].n; x++) {
            const Window wy = window(reference.y, y), wx = window(reference.x, x);
            const Footprint exact = footprint(reference, wy, wx, y, x), rough = footprint(tried, wy, wx, y, x);
            for (size_t p = 0; p < exact.size(); p++) {
                error += (rough[p] - exact[p]) * (rough[p] - exact[p]);
                square += exact[p] * exact[p];
                value += exact[p];
            }
        }
    }
    // A ray sums nz slices of independent voxels with mean 1/2 and variance 1/12.
    double relative(int nz) const {
        const double signal = value * nz / 4 + square / 12;
        return signal > 0 ? std::sqrt(error / 12 / signal) : 0;
    }
};

constexpr int slices = 3; // first, middle and last

std::vector<SampledWeights> sampled_weights(const ScanGeometry& g, const View& v, int subslices, int moments) {
    std::vector<SampledWeights> out;
    for (int z : {0, g.grid.nz / 2, g.grid.nz - 1}) out.emplace_back(g, v, z, subslices, moments);
    return out;
}

double error(const ScanGeometry& g, const std::vector<SampledWeights>& tried,
             const std::vector<SampledWeights>& reference) {
    FootprintError sum;
    for (int i = 0; i < slices; i++)
        for (int y = 0; y < tried[i].y[0].n; y++) sum.add(tried[i], reference[i], y);
    return sum.relative(g.grid.nz);
}

// The same view with an unbounded panel: what is chosen then does not depend on which part of the volume the panel
// sees.
View with_unbounded_panel(View v) {
    const int margin = 1 << 16; // pixels
    v.first_x -= margin * v.pitch_a;
    v.first_y -= margin * v.pitch_b;
    v.na += 2 * margin;
    v.nb += 2 * margin;
    return v;
}

// The fewest products of sub-slices and moments that are within the tolerance.
void find_products(const ScanGeometry& g, const View& plain, View& v) {
    const std::vector<SampledWeights> reference = sampled_weights(g, plain, max_subslices, max_moments);
    for (int count = 1; count <= max_subslices * max_moments; count++)
        for (v.moments = max_moments; v.moments >= 1; v.moments--) { // more moments err less than as many sub-slices
            v.subslices = count / v.moments;
            if (count % v.moments != 0 || v.subslices > max_subslices) continue;
            if (error(g, sampled_weights(g, plain, v.subslices, v.moments), reference) <= g.tolerance) return;
        }
    v.subslices = max_subslices;
    v.moments = max_moments;
}

// The row in the middle of those whose projections move so little that the first m moments are within the tolerance,
// and half their number. The error grows with how far a row's projection moves, that is with the row's distance from
// the source. It is taken to grow linearly, as fast as at the steepest sample.
void find_rows_of_fewer_moments(const ScanGeometry& g, const View& unbounded, const Grid& grid, View& v) {
    v.source_row = (v.source[1] - grid.y0) / grid.dy;
    const std::vector<SampledWeights> reference = sampled_weights(g, unbounded, v.subslices, v.moments);
    const std::vector<int> rows = sample_voxels(grid.ny);
    for (int m = 1; m < v.moments; m++) {
        const std::vector<SampledWeights> fewer = sampled_weights(g, unbounded, v.subslices, m);
        double steepest = 0;
        for (size_t y = 0; y < rows.size(); y++) {
            FootprintError sum;
            for (int i = 0; i < slices; i++) sum.add(fewer[i], reference[i], int(y));
            steepest = std::max(steepest, sum.relative(g.grid.nz) / std::max(std::fabs(rows[y] - v.source_row), 1.0));
        }
        v.half_width[m] = std::max(v.half_width[m - 1], steepest > 0 ? g.tolerance / steepest : 0);
    }
}

// The largest truncation of small weights within the tolerance.
void find_truncation(const ScanGeometry& g, View unbounded, View& v) {
    const std::vector<SampledWeights> reference = sampled_weights(g, unbounded, max_subslices, max_moments);
    for (double share = max_truncation; share >= 1; share /= 2) {
        unbounded.truncation = share * g.tolerance;
        if (error(g, sampled_weights(g, unbounded, v.subslices, v.moments), reference) > g.tolerance) continue;
        v.truncation = unbounded.truncation;
        return;
    }
}

void choose_of_view(const ScanGeometry& g, View& v) {
    const Grid grid = g.seen_by(v);
    Resampling resampling = std::move(v.resampling); // the weights do not read it: it need not be copied
    v.source_row = v.truncation = 0;
    v.half_width = {};
    const View plain = v; // all rows of voxels need all moments, no weight is truncated
    v.resampling = std::move(resampling);
    find_products(g, plain, v);
    v.path.thickness = g.grid.dz / v.subslices;
    if (v.orientation == PanelOrientation::rotated) return;
    if (v.moments > 1) find_rows_of_fewer_moments(g, with_unbounded_panel(plain), grid, v);
    find_truncation(g, with_unbounded_panel(plain), v);
}

} // namespace

void choose_subslices(ScanGeometry& geometry) {
    parallel(int64_t(geometry.views.size()), [&](int64_t begin, int64_t end, int) {
        for (int64_t k = begin; k < end; k++) choose_of_view(geometry, geometry.views[k]);
    });
}

} // namespace palpate
