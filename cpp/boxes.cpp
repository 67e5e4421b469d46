#include "boxes.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

int rounded_up(int n, int multiple) { return (n + multiple - 1) / multiple * multiple; }

// (a, b) on the parallel panel to (row, column) on the measured one, along rays from the focal spot: rows of a 3x3
// matrix give row, column and their common divisor.
void homography(const View& v, double out[9]) {
    const Panel& p = v.panel;
    Vec3 normal, from;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        normal[i] = p.rows_along[j] * p.columns_along[k] - p.rows_along[k] * p.columns_along[j];
        from[i] = p.origin[i] - v.source[i];
    }
    double reach = from[0] * normal[0] + from[1] * normal[1] + from[2] * normal[2];
    const Vec3 base = {v.left - v.source[0], v.low - v.source[1], v.height - v.source[2]};
    // A ray d = base + a·pa·x + b·pb·y lands at s + (reach / d·n) d; its row is that minus the origin, along rows / dv.
    for (int line = 0; line < 3; line++) {
        Vec3 w;
        for (int i = 0; i < 3; i++) {
            if (line == 2) {
                w[i] = normal[i];
                continue;
            }
            const Vec3& axis = line ? p.columns_along : p.rows_along;
            double pitch = line ? p.du : p.dv, offset = from[0] * axis[0] + from[1] * axis[1] + from[2] * axis[2];
            w[i] = (reach * axis[i] - offset * normal[i]) / pitch;
        }
        out[3 * line] = w[0] * v.pa;
        out[3 * line + 1] = w[1] * v.pb;
        out[3 * line + 2] = w[0] * base[0] + w[1] * base[1] + w[2] * base[2];
    }
}

// Rows of the fine panel under the tallest measured pixel.
int tallest_pixel(const View& v) {
    const Sparse& measured = v.resampling.measured;
    int most = 1;
    for (size_t i = 0; i + 1 < measured.offset.size(); i++)
        if (measured.offset[i] < measured.offset[i + 1])
            most = std::max(most, measured.index[measured.offset[i + 1] - 1] / v.na -
                                      measured.index[measured.offset[i]] / v.na + 1);
    return most;
}

} // namespace

void PackedAxis::make(const Geometry& geometry, const View& view, int z, Axis axis, int multiple) {
    std::vector<AxisWeights> parts(view.subs);
    subs = view.subs;
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
    if (multiple > 1) // whole vectors at the end of a row must not reach into the next one
        for (int i = 0; i < n; i++) {
            const int held = std::clamp((axis == Axis::x ? view.na : view.nb) + column_padding - width, 0, first[i]);
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

void SliceFootprints::make(const Geometry& geometry, const View& chosen, int z) {
    if (view != &chosen && chosen.resampled) {
        homography(chosen, seen);
        fine_rows = tallest_pixel(chosen);
    }
    if (!chosen.resampled) fine_rows = 1;
    view = &chosen;
    along_x.make(geometry, chosen, z, Axis::x, lanes);
    along_y.make(geometry, chosen, z, Axis::y, 1);
}

int SliceFootprints::rows_apart() const {
    const int n = int(along_y.first.size());
    int apart = 1;
    for (int y = 0; y < n; y++) {
        if (along_y.count[y] == 0) continue;
        const int end = along_y.first[y] + along_y.count[y] + fine_rows - 1;
        while (y + apart < n && along_y.count[y + apart] > 0 && along_y.first[y + apart] < end) apart++;
    }
    return apart;
}

int64_t SliceFootprints::capacity() const {
    if (!view->resampled) return int64_t(along_x.width) * along_y.width;
    // The steps of a homography N/D along a and b are (n D − N d)/D²: the numerator is affine, so that it is largest at a
    // corner of the fine panel, where D is smallest too.
    double step[2][2] = {}, divisor = 1e300;
    for (int corner = 0; corner < 4; corner++) {
        const double p = corner & 1 ? view->na - 0.5 : -0.5, q = corner >> 1 ? view->nb - 0.5 : -0.5;
        const double D = seen[6] * p + seen[7] * q + seen[8];
        divisor = std::min(divisor, D * D);
        for (int i = 0; i < 2; i++) {
            const double N = seen[3 * i] * p + seen[3 * i + 1] * q + seen[3 * i + 2];
            for (int j = 0; j < 2; j++)
                step[i][j] = std::max(step[i][j], std::fabs(seen[3 * i + j] * D - N * seen[6 + j]));
        }
    }
    auto extent = [&](int i) {
        return int((step[i][0] * along_x.width + step[i][1] * along_y.width) / divisor) + 3;
    };
    return int64_t(std::min(extent(0), view->panel.rows)) * rounded_up(std::min(extent(1), view->panel.columns), lanes);
}

PALPATE_KERNEL void SliceFootprints::parallel_panel(int y, int x, float* weight, Box& out) const {
    out.row = along_y.first[y];
    out.height = along_x.count[x] ? along_y.count[y] : 0;
    out.column = along_x.first[x];
    out.width = along_x.width;
    out.weight = weight;
    for (int v = 0; v < out.height; v++)
        for (int u = 0; u < out.width; u += lanes, weight += lanes) {
            Lanes sum = {}, part;
            for (int s = 0; s < along_x.subs; s++) {
                load(part, along_x.of(x, s) + u);
                sum += part * along_y.of(y, s)[v];
            }
            store(weight, sum);
        }
}

void SliceFootprints::tilted_bounds(int y, int x, int bounds[4]) const {
    const double a[2] = {along_x.first[x] - 0.5, along_x.first[x] + along_x.count[x] - 0.5};
    const double b[2] = {along_y.first[y] - 0.5, along_y.first[y] + along_y.count[y] - 0.5};
    double low[2] = {1e9, 1e9}, high[2] = {-1e9, -1e9};
    for (int corner = 0; corner < 4; corner++) {
        const double p = a[corner & 1], q = b[corner >> 1], divisor = seen[6] * p + seen[7] * q + seen[8];
        for (int i = 0; i < 2; i++) {
            const double at = (seen[3 * i] * p + seen[3 * i + 1] * q + seen[3 * i + 2]) / divisor;
            low[i] = std::min(low[i], at);
            high[i] = std::max(high[i], at);
        }
    }
    for (int i = 0; i < 2; i++) { // rounding must not lose a pixel that is barely touched
        const int last = (i ? view->panel.columns : view->panel.rows) - 1;
        bounds[2 * i] = std::clamp(int(std::floor(low[i] + 0.5 - 1e-3)), 0, last);
        bounds[2 * i + 1] = std::clamp(int(std::floor(high[i] + 0.5 + 1e-3)), 0, last);
    }
}

void SliceFootprints::tilted(int y, int x, float* weight, float* scratch, Box& out) const {
    out = {};
    out.weight = weight;
    if (along_x.count[x] == 0 || along_y.count[y] == 0) return;
    const Sparse& fine = view->resampling.fine;
    const int64_t* offset = fine.offset.data();
    const int32_t* index = fine.index.data();
    const float* part = fine.weight.data();
    for (int v = 0; v < along_y.count[y]; v++) {
        const int64_t start = int64_t(along_y.first[y] + v) * view->na + along_x.first[x];
        for (int u = 0; u < along_x.count[x]; u++) {
            float w = 0;
            for (int s = 0; s < along_x.subs; s++) w += along_y.of(y, s)[v] * along_x.of(x, s)[u];
            for (int64_t e = offset[start + u]; e < offset[start + u + 1]; e++) scratch[index[e]] += w * part[e];
        }
    }
    int b[4];
    tilted_bounds(y, x, b);
    const int columns = b[3] - b[2] + 1;
    out.row = b[0];
    out.column = b[2];
    out.height = b[1] - b[0] + 1;
    out.width = rounded_up(columns, lanes);
    for (int v = 0; v < out.height; v++, weight += out.width) {
        float* from = scratch + int64_t(out.row + v) * view->panel.columns + out.column;
        std::copy_n(from, columns, weight);
        std::fill_n(weight + columns, out.width - columns, 0.0f);
        std::fill_n(from, columns, 0.0f);
    }
}

} // namespace palpate
