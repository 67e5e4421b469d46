#include "projection/panel_resampling.h"
#include "base/thread_pool.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

struct Point {
    double a, b;
};

// Part of a convex polygon with coordinate `axis` on the kept side of `line` (Sutherland & Hodgman, CACM 17, 1974).
int clip(const Point* in, int count, Point* out, int axis, double line, double side) {
    int kept = 0;
    for (int i = 0; i < count; i++) {
        const Point &p = in[i], &q = in[(i + 1) % count];
        double s = side * ((axis ? p.b : p.a) - line), t = side * ((axis ? q.b : q.a) - line);
        if (s >= 0) out[kept++] = p;
        if ((s >= 0) != (t >= 0)) out[kept++] = {p.a + (q.a - p.a) * s / (s - t), p.b + (q.b - p.b) * s / (s - t)};
    }
    return kept;
}

double area(const Point* p, int count) {
    double twice = 0;
    for (int i = 0; i < count; i++) {
        const Point &u = p[i], &v = p[(i + 1) % count];
        twice += u.a * v.b - v.a * u.b;
    }
    return std::fabs(twice) / 2;
}

// Calls visit(index, weight) for each fine pixel that a quadrilateral covers: clipped to rows, then to pixels.
template <class Visit> void cover(const Point* quad, int na, int nb, Visit visit) {
    for (int i = 0; i < 4; i++) // a pixel whose rays do not meet the parallel panel sees nothing
        if (!std::isfinite(quad[i].a) || !std::isfinite(quad[i].b)) return;
    auto [a0, a1] = std::minmax({quad[0].a, quad[1].a, quad[2].a, quad[3].a});
    auto [b0, b1] = std::minmax({quad[0].b, quad[1].b, quad[2].b, quad[3].b});
    const double whole = area(quad, 4);
    if (!(whole > 0) || a1 <= -0.5 || b1 <= -0.5 || a0 >= na - 0.5 || b0 >= nb - 0.5) return;
    Point low[12], strip[12], left[12], cell[12];
    const int first_b = int(std::max(0.0, b0 + 0.5)), last_b = int(std::min(nb - 1.0, b1 + 0.5));
    const int first_a = int(std::max(0.0, a0 + 0.5)), last_a = int(std::min(na - 1.0, a1 + 0.5));
    for (int b = first_b; b <= last_b; b++) {
        int n = clip(quad, 4, low, 1, b - 0.5, 1);
        n = clip(low, n, strip, 1, b + 0.5, -1);
        if (n < 3) continue;
        for (int a = first_a; a <= last_a; a++) {
            int m = clip(strip, n, left, 0, a - 0.5, 1);
            m = clip(left, m, cell, 0, a + 0.5, -1);
            if (m < 3) continue;
            float weight = float(area(cell, m) / whole);
            if (weight > 1e-6f) visit(int32_t(b) * na + a, weight);
        }
    }
}

SparseRows transpose(const SparseRows& rows, int columns) {
    SparseRows out;
    out.offset.assign(columns + 1, 0);
    out.index.resize(rows.index.size());
    out.weight.resize(rows.index.size());
    for (int32_t j : rows.index) out.offset[j + 1]++;
    for (int j = 0; j < columns; j++) out.offset[j + 1] += out.offset[j];
    std::vector<int64_t> next(out.offset.begin(), out.offset.end() - 1);
    for (int64_t i = 0; i + 1 < int64_t(rows.offset.size()); i++)
        for (int64_t e = rows.offset[i]; e < rows.offset[i + 1]; e++) {
            int64_t place = next[rows.index[e]]++;
            out.index[place] = int32_t(i);
            out.weight[place] = rows.weight[e];
        }
    return out;
}

} // namespace

Resampling resampling(int rows, int columns, const std::vector<double>& corners, int na, int nb) {
    std::vector<std::vector<std::pair<int32_t, float>>> found(rows);
    std::vector<int64_t> counts(int64_t(rows) * columns + 1, 0);
    parallel(rows, [&](int64_t r0, int64_t r1, int) {
        for (int64_t r = r0; r < r1; r++)
            for (int c = 0; c < columns; c++) {
                auto corner = [&](int64_t i, int64_t j) {
                    const double* p = &corners[2 * (i * (columns + 1) + j)];
                    return Point{p[0], p[1]};
                };
                const Point quad[4] = {corner(r, c), corner(r, c + 1), corner(r + 1, c + 1), corner(r + 1, c)};
                size_t before = found[r].size();
                cover(quad, na, nb, [&](int32_t i, float w) { found[r].push_back({i, w}); });
                counts[r * columns + c + 1] = int64_t(found[r].size() - before);
            }
    });
    Resampling result;
    result.fine_count = na * nb;
    SparseRows& rows_of = result.measured;
    for (size_t i = 1; i < counts.size(); i++) counts[i] += counts[i - 1];
    rows_of.offset = std::move(counts);
    rows_of.index.reserve(rows_of.offset.back());
    rows_of.weight.reserve(rows_of.offset.back());
    for (auto& row : found) {
        for (auto [i, w] : row) {
            rows_of.index.push_back(i);
            rows_of.weight.push_back(w);
        }
        row = {};
    }
    result.fine = transpose(rows_of, na * nb);
    return result;
}

void apply(const SparseRows& rows, const float* in, float* out) {
    parallel(int64_t(rows.offset.size()) - 1, [&](int64_t begin, int64_t end, int) {
        for (int64_t i = begin; i < end; i++) {
            float sum = 0;
            for (int64_t e = rows.offset[i]; e < rows.offset[i + 1]; e++) sum += rows.weight[e] * in[rows.index[e]];
            out[i] = sum;
        }
    });
}

} // namespace palpate
