#include "boxes.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

int rounded_up(int n, int multiple) { return (n + multiple - 1) / multiple * multiple; }

// Rows of the fine panel under the tallest measured pixel.
int tallest_pixel(const View& v) {
    const Sparse& measured = v.resampling.measured;
    int most = 1;
    for (size_t i = 0; i + 1 < measured.offset.size(); i++) {
        int low = INT32_MAX, high = -1;
        for (int64_t e = measured.offset[i]; e < measured.offset[i + 1]; e++) {
            low = std::min(low, measured.index[e] / v.na);
            high = std::max(high, measured.index[e] / v.na);
        }
        if (high >= 0) most = std::max(most, high - low + 1);
    }
    return most;
}

// Rows under row y of voxels in each column of a turned panel, widening low and high. Numerical kernel.
PALPATE_KERNEL void column_bounds(const double* __restrict slope1, const double* __restrict offset1,
                                  const double* __restrict slope2, const double* __restrict offset2, int y, int nb,
                                  int na, int32_t* __restrict low, int32_t* __restrict high) {
    for (int a = 0; a < na; a++) {
        const double l1 = slope1[a] * y + offset1[a], l2 = slope2[a] * y + offset2[a];
        const double r1 = slope1[a] * (y + 1) + offset1[a], r2 = slope2[a] * (y + 1) + offset2[a];
        const double first = std::min(std::max(std::floor(std::min(l1, l2) + 0.5), 0.0), double(nb));
        const double last = std::max(std::min(std::floor(std::max(r1, r2) + 0.5), nb - 1.0), -1.0);
        low[a] = std::min(low[a], int32_t(first));
        high[a] = std::max(high[a], int32_t(last));
    }
}

// The same weights as Footprints gives a turned panel, for row y of voxels and all columns: weight[t * stride + a]
// belongs to row low[a] + t, which may lie beyond the image. One division an edge instead of one a tap. Numerical
// kernel.
PALPATE_KERNEL void column_taps(const double* __restrict slope1, const double* __restrict offset1,
                                const double* __restrict slope2, const double* __restrict offset2, int y, int taps,
                                int na, int64_t stride, const int32_t* __restrict low, double* __restrict per_move,
                                float* __restrict weight) {
    for (int a = 0; a < na; a++) {
        const double left = (slope2[a] - slope1[a]) * y + offset2[a] - offset1[a];
        const double right = (slope2[a] - slope1[a]) * (y + 1) + offset2[a] - offset1[a];
        per_move[a] = std::fabs(left) < 1e-6 ? 0 : 1 / left;
        per_move[na + a] = std::fabs(right) < 1e-6 ? 0 : 1 / right;
    }
    for (int t = 0; t < taps; t++)
        for (int a = 0; a < na; a++) {
            const double q = low[a] + t - 0.5;
            const double l1 = slope1[a] * y + offset1[a] - q, l2 = slope2[a] * y + offset2[a] - q;
            const double r1 = l1 + slope1[a], r2 = l2 + slope2[a];
            const double still_left = std::min(std::max(0.5 * (l1 + l2), 0.0), 1.0);
            const double still_right = std::min(std::max(0.5 * (r1 + r2), 0.0), 1.0);
            const double left = per_move[a] == 0 ? still_left : (rise(l2) - rise(l1)) * per_move[a];
            const double right = per_move[na + a] == 0 ? still_right : (rise(r2) - rise(r1)) * per_move[na + a];
            weight[t * stride + a] = float(right - left);
        }
}

} // namespace

Layout::Layout(const View& view) {
    boxed = view.pose == Pose::parallel || (view.pose == Pose::turned && !view.swapped);
    if (boxed) {
        rows = view.swapped ? view.na : view.nb;
        columns = view.swapped ? view.nb : view.na;
        start = view.start;
        down = view.swapped ? view.step_a : view.step_b;
        right = view.swapped ? view.step_b : view.step_a;
        stride = columns + column_padding;
    } else {
        rows = view.panel.rows;
        columns = view.panel.columns;
        start = 0;
        down = stride = columns;
        right = 1;
    }
}

void PackedAxis::make(const Geometry& geometry, const View& view, int z, Axis axis, int multiple, int pixels) {
    std::vector<AxisWeights> parts(products(view));
    subs = products(view);
    for (int s = 0; s < subs; s++) by_voxel(geometry, view, z, s, axis, parts[s]);
    const int n = parts[0].n;
    first.assign(n, 0);
    count.assign(n, 0);
    int widest = 1;
    for (int i = 0; i < n; i++) {
        int low = INT32_MAX, high = -1;
        for (const AxisWeights& part : parts)
            for (int t = 0; t < part.taps; t++)
                if (part.weight[size_t(t) * n + i] != 0) {
                    low = std::min(low, part.first[i] + t);
                    high = std::max(high, part.first[i] + t);
                }
        if (high < 0) continue; // off the panel
        first[i] = low;
        count[i] = high - low + 1;
        widest = std::max(widest, count[i]);
    }
    width = rounded_up(widest, multiple);
    for (int i = 0; i < n; i++) { // vectors at the end of a row must not reach into the next one
        const int held = std::clamp(pixels + column_padding - width, 0, int(first[i]));
        count[i] += count[i] ? first[i] - held : 0;
        first[i] = held;
    }
    weight.assign(size_t(n) * subs * width, 0);
    for (int i = 0; i < n; i++)
        for (int s = 0; s < subs; s++)
            for (int t = 0; t < parts[s].taps; t++)
                if (float w = parts[s].weight[size_t(t) * n + i])
                    weight[(size_t(i) * subs + s) * width + parts[s].first[i] + t - first[i]] = w;
}

void SliceBoxes::make(const Geometry& geometry, const View& chosen, int z) {
    const Layout layout(chosen);
    if (view != &chosen) fine_rows = chosen.pose == Pose::tilted ? tallest_pixel(chosen) : 1;
    view = &chosen;
    boxed = layout.boxed;
    stride = layout.stride;
    measured = geometry.pixels();
    ny = geometry.grid.ny;
    const Axis x = chosen.swapped ? Axis::y : Axis::x, y = chosen.swapped ? Axis::x : Axis::y;
    if (boxed) along_x.make(geometry, chosen, z, x, lanes, layout.columns);
    if (boxed && chosen.pose == Pose::turned) {
        edges.resize(chosen.subs);
        for (int s = 0; s < chosen.subs; s++) rows(geometry, chosen, z, s, edges[s]);
        drift = edges_drift();
    } else {
        along_y.make(geometry, chosen, z, y, 1, INT32_MAX / 2);
    }
}

int SliceBoxes::rows_apart() const {
    if (boxed && view->pose == Pose::turned) return turned_rows_apart();
    int apart = 1;
    for (int y = 0; y < ny; y++) {
        if (along_y.count[y] == 0) continue;
        const int end = along_y.first[y] + along_y.count[y] + fine_rows - 1;
        while (y + apart < ny && along_y.count[y + apart] > 0 && along_y.first[y + apart] < end) apart++;
    }
    return apart;
}

// How far the edges of the rows move over the columns of one box, in rows of the image.
double SliceBoxes::edges_drift() const {
    double most = 0;
    for (const Rows& e : edges)
        for (int y : {0, ny})
            for (int a = along_x.width; a < view->na; a++) {
                const int before = a - along_x.width;
                const double first = (e.slope1[a] - e.slope1[before]) * y + e.offset1[a] - e.offset1[before];
                const double second = (e.slope2[a] - e.slope2[before]) * y + e.offset2[a] - e.offset2[before];
                most = std::max({most, std::fabs(first), std::fabs(second)});
            }
    return most;
}

// In column a, row y of voxels covers up to max(l1, l2)(y + 1) and row y + apart begins at min(l1, l2)(y + apart): that
// gap is concave in y, so it is least at an end. Boxes are a few columns wide, over which both edges drift.
int SliceBoxes::turned_rows_apart() const {
    for (int apart = 1; apart < ny; apart++) {
        double gap = 1e300;
        for (int a = 0; a < view->na; a++)
            for (int y : {0, ny - apart}) {
                double end = -1e300, begin = 1e300;
                for (const Rows& e : edges) {
                    end = std::max({end, e.slope1[a] * (y + 1) + e.offset1[a], e.slope2[a] * (y + 1) + e.offset2[a]});
                    begin = std::min(
                        {begin, e.slope1[a] * (y + apart) + e.offset1[a], e.slope2[a] * (y + apart) + e.offset2[a]});
                }
                gap = std::min(gap, begin - end);
            }
        if (gap > 1 + 2 * drift) return apart;
    }
    return ny;
}

void SliceBoxes::begin_row(int y, RowScratch& s) const {
    if (!boxed) {
        if (int64_t(s.sums.size()) < measured) s.sums.assign(measured, 0);
        return;
    }
    if (view->pose != Pose::turned) {
        s.weight.resize(std::max(s.weight.size(), size_t(along_x.width) * along_y.width));
        return;
    }
    const int na = view->na, subs = view->subs;
    s.low.assign(na, view->nb);
    s.high.assign(na, -1);
    for (const Rows& e : edges)
        column_bounds(e.slope1.data(), e.offset1.data(), e.slope2.data(), e.offset2.data(), y, view->nb, na,
                      s.low.data(), s.high.data());
    s.taps = 0;
    for (int a = 0; a < na; a++) s.taps = std::max(s.taps, s.high[a] - s.low[a] + 1);
    s.column.resize(size_t(subs) * s.taps * stride); // what lies beyond the columns is finite and gets weight 0
    s.per_move.resize(2 * size_t(na));
    for (int i = 0; i < subs; i++)
        column_taps(edges[i].slope1.data(), edges[i].offset1.data(), edges[i].slope2.data(), edges[i].offset2.data(), y,
                    s.taps, na, stride, s.low.data(), s.per_move.data(),
                    s.column.data() + int64_t(i) * s.taps * stride);
    s.weight.resize(std::max(s.weight.size(), size_t(along_x.width) * (s.taps + int(drift) + 2)));
}

PALPATE_KERNEL void SliceBoxes::parallel_box(int y, int x, RowScratch& s, Box& out) const {
    out.row = along_y.first[y];
    out.height = along_x.count[x] ? along_y.count[y] : 0;
    out.column = along_x.first[x];
    out.width = along_x.width;
    float* weight = out.weight = s.weight.data();
    for (int v = 0; v < out.height; v++)
        for (int u = 0; u < out.width; u += lanes, weight += lanes) {
            Lanes sum = {}, part;
            for (int i = 0; i < along_x.subs; i++) {
                load(part, along_x.of(x, i) + u);
                sum += part * along_y.of(y, i)[v];
            }
            store(weight, sum);
        }
}

PALPATE_KERNEL void SliceBoxes::turned_box(int x, RowScratch& s, Box& out) const {
    const int begin = along_x.first[x], end = begin + along_x.count[x];
    int low = INT32_MAX, highest_low = -1, high = -1;
    for (int a = begin; a < end; a++) {
        low = std::min(low, s.low[a]);
        highest_low = std::max(highest_low, s.low[a]);
        high = std::max(high, s.high[a]);
    }
    out.row = low;
    out.height = std::max(0, high - low + 1);
    out.column = begin;
    out.width = along_x.width;
    float* weight = out.weight = s.weight.data();
    if (highest_low == low) { // all columns begin in the same row, as most do
        for (int v = 0; v < out.height; v++)
            for (int u = 0; u < out.width; u += lanes, weight += lanes) {
                Lanes sum = {}, part, rows;
                for (int i = 0; i < along_x.subs; i++) {
                    load(part, along_x.of(x, i) + u);
                    load(rows, &s.column[(int64_t(i) * s.taps + v) * stride + begin + u]);
                    sum += part * rows;
                }
                store(weight, sum);
            }
        return;
    }
    std::fill_n(weight, size_t(out.height) * out.width, 0.0f);
    for (int a = begin; a < end; a++)
        for (int i = 0; i < along_x.subs; i++)
            for (int b = s.low[a]; b <= s.high[a]; b++)
                weight[(b - low) * out.width + a - begin] +=
                    along_x.of(x, i)[a - begin] * s.column[(int64_t(i) * s.taps + b - s.low[a]) * stride + a];
}

void SliceBoxes::list(const Footprints& all, int k, int y, int x, RowScratch& s, Box& out) const {
    s.pixels.clear();
    all.visit(k, y, x, [&](int64_t pixel, float weight) {
        if (weight == 0) return;
        if (s.sums[pixel] == 0) s.pixels.push_back(pixel);
        s.sums[pixel] += weight;
    });
    s.weight.resize(std::max(s.weight.size(), s.pixels.size()));
    for (size_t i = 0; i < s.pixels.size(); i++) {
        s.weight[i] = s.sums[s.pixels[i]];
        s.sums[s.pixels[i]] = 0;
    }
    out = {};
    out.weight = s.weight.data();
    out.count = int64_t(s.pixels.size());
    out.pixels = s.pixels.data();
}

void SliceBoxes::box(const Footprints& all, int k, int y, int x, RowScratch& scratch, Box& out) const {
    if (!boxed) return list(all, k, y, x, scratch, out);
    view->pose == Pose::turned ? turned_box(x, scratch, out) : parallel_box(y, x, scratch, out);
}

} // namespace palpate
