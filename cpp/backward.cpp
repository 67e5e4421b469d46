// Backprojection of the separable views, in tiles of the volume. The tiles of a few slices, one above the other, stay
// in the second-level cache while view after view adds to them: a copy of the part of its image under them, scaled by
// the rays' path, stays in the first while all of them read it.
#include "backward.h"
#include "buffer.h"
#include "lengths.h"
#include "parallel.h"
#include "passes.h"
#include "sliding.h"
#include "stream.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int stack = 2;            // tiles of a slice, one behind the other along y, that share their weights along x
constexpr int depth = 16;           // slices of a task, at most
constexpr int soon = 8;             // rows of a panel to call for in advance
constexpr int padding = slide_span; // columns beyond a window, so that whole vectors fit

// The part of a view's image under a task's tiles: rows b0 to b1, columns a0 to a1. Where pixels are finer than voxels
// its rows are halved (see ColumnSpans): a0 is even, and the odd columns begin `jump` after the even ones.
struct Window {
    int b0, b1, a0, a1;
    int64_t stride, jump;

    bool empty() const { return b0 >= b1 || a0 >= a1; }
    // Pixel (0, 0) of the image, were the window all of it, and where its columns end.
    Source source(const float* values) const {
        const int from = jump ? a0 / 2 : a0;
        return {values - b0 * stride - from, stride, int(from + (jump ? jump : stride))};
    }
};

// What a thread needs, kept between its tasks.
struct Scratch {
    std::vector<Spans> rows;     // of the task's rows: per view, sub-slice, tile of the stack
    std::vector<Shadow> shadows; // along x: per view, sub-slice
    ColumnSpans columns;
    RowRing ring;
    Buffer sum; // per slice, tile of the stack
    Buffer window, row;
    Lengths lengths;
};

void copy_window(const View& v, const float* image, const Window& w, Scratch& s) {
    const int columns = w.a1 - w.a0;
    const size_t size = (w.b1 - w.b0) * w.stride;
    if (s.window.size() < size) s.window.resize(size);
    if (int(s.row.size()) < columns) s.row.resize(columns);
    if (v.pose != Pose::tilted) s.lengths.make(v, w.a0, columns, w.b0, w.b1);
    for (int b = w.b0; b < w.b1; b++) {
        float* to = &s.window[(b - w.b0) * w.stride];
        float* whole = w.jump ? s.row.data() : to;
        if (v.pose == Pose::tilted) {
            std::copy_n(image + int64_t(b) * v.na + w.a0, columns, whole);
        } else {
            const float* from = image + v.start + b * v.step_b + w.a0 * v.step_a;
            for (int a = 0; a < columns + cache_line - 1; a += cache_line)
                __builtin_prefetch(from + soon * v.step_b + a * v.step_a, 0, 3);
            if (v.step_a != 1) {
                for (int a = 0; a < columns; a++) whole[a] = from[a * v.step_a];
                from = whole;
            }
            s.lengths.scale(b, from, whole);
        }
        if (w.jump) {
            const int odd = columns / 2, even = columns - odd;
            for (int a = 0; a < odd; a++) to[a] = whole[2 * a], to[w.jump + a] = whole[2 * a + 1];
            if (even > odd) to[odd] = whole[2 * odd];
            std::fill(to + even, to + w.jump, 0.0f);
            std::fill(to + w.jump + odd, to + w.stride, 0.0f);
        } else {
            std::fill(to + columns, to + w.stride, 0.0f);
        }
    }
}

// Slices z0 to z1, rows y0 to y1 (`stack` tiles at most), from all views.
struct Task {
    const Geometry& g;
    const std::vector<const float*>& images;
    float* f;
    const int z0, z1, y0, y1;

    int tiles() const { return (y1 - y0 + height - 1) / height; }
    int subs(size_t k) const { return images[k] ? (z1 - z0) * g.views[k].subs : 0; }
    float* sum_of(Scratch& s, int z, int t) const { return &s.sum[((z - z0) * stack + t) * height * width]; }

    void run(Scratch& s) const {
        std::vector<size_t> first(g.views.size() + 1, 0); // sub-slice of each view, in s.rows and s.shadows
        for (size_t k = 0; k < g.views.size(); k++) first[k + 1] = first[k] + subs(k);
        if (s.rows.size() < first.back() * stack) s.rows.resize(first.back() * stack);
        s.shadows.resize(first.back());
        s.sum.resize((z1 - z0) * stack * height * width);
        for (size_t k = 0; k < g.views.size(); k++) cast_rows(k, first[k], s);
        for (int x0 = 0; x0 < g.grid.nx; x0 += width) {
            const int x1 = std::min(g.grid.nx, x0 + width);
            std::fill(s.sum.begin(), s.sum.end(), 0.0f);
            for (size_t k = 0; k < g.views.size(); k++)
                if (images[k]) add_view(k, first[k], x0, x1, s);
            for (int z = z0; z < z1; z++)
                for (int y = y0; y < y1; y++) {
                    float* to = f + (int64_t(z) * g.grid.ny + y) * g.grid.nx + x0;
                    stream(sum_of(s, z, 0) + (y - y0) * width, x1 - x0, to);
                }
        }
        streamed();
    }

private:
    void cast_rows(size_t k, size_t first, Scratch& s) const {
        const View& v = g.views[k];
        for (int d = 0; d < subs(k); d++) {
            const int z = z0 + d / v.subs, sub = d % v.subs;
            s.shadows[first + d] = shadow(g, v, z, sub, Axis::x);
            const Shadow along = shadow(g, v, z, sub, Axis::y);
            for (int t = 0; t < tiles(); t++) {
                Spans& rows = s.rows[(first + d) * stack + t];
                const int y = y0 + t * height;
                under_voxels(along, v.moments, y, std::min(height, y1 - y), g.grid.ny, v.nb, rows);
                calm_voxels(v, y, rows);
            }
        }
    }

    Window window(size_t k, size_t first, int x0, int x1, const Scratch& s) const {
        const View& v = g.views[k];
        Window w = {v.nb, 0, v.na, 0, 0, 0};
        for (int d = 0; d < subs(k); d++) {
            bool reached = false;
            for (int t = 0; t < tiles(); t++) {
                const Spans& rows = s.rows[(first + d) * stack + t];
                if (!rows.reached) continue;
                reached = true;
                w.b0 = std::min(w.b0, rows.begin);
                w.b1 = std::max(w.b1, rows.end);
            }
            const Shadow& x = s.shadows[first + d];
            for (int face = 0; face < 2 && reached; face++) {
                const double low = x.offset[face] + x.slope[face] * x0, high = x.offset[face] + x.slope[face] * x1;
                w.a0 = std::min(w.a0, int(std::min(std::max(std::floor(low), 0.0), double(v.na))));
                w.a1 = std::max(w.a1, int(std::min(std::max(std::ceil(high), 0.0), double(v.na))));
            }
        }
        if (w.empty()) return w;
        const double slope = s.shadows[first].slope[0];
        if (slope > 1 && !(slides() && 20 * slope < slide_span)) { // eight voxels shadow more than eight pixels
            w.a0 -= w.a0 % 2;
            w.jump = ((w.a1 - w.a0 + 1) / 2 + padding + lanes - 1) / lanes * lanes;
            w.stride = 2 * w.jump;
        } else {
            // Sixteen columns that slide may begin further left instead.
            const int columns = slides() ? std::max(w.a1 - w.a0, slide_span) : w.a1 - w.a0 + padding;
            w.stride = (columns + lanes - 1) / lanes * lanes;
        }
        return w;
    }

    void add_view(size_t k, size_t first, int x0, int x1, Scratch& s) const {
        const View& v = g.views[k];
        const Window w = window(k, first, x0, x1, s);
        if (w.empty()) return;
        copy_window(v, images[k], w, s);
        const Source source = w.source(s.window.data());
        for (int d = 0; d < subs(k); d++) {
            const Spans* rows = &s.rows[(first + d) * stack];
            const int moments = most_moments_of(rows, tiles());
            if (moments == 0) continue;
            under_voxels(s.shadows[first + d], moments, x0, x1 - x0, g.grid.nx, v.na, s.columns.spans);
            if (!s.columns.spans.reached) continue;
            w.jump ? s.columns.prepare_halved(source.columns, w.jump) : s.columns.prepare(source.columns);
            for (int t = 0; t < tiles(); t++)
                if (rows[t].reached) add_slice(source, rows[t], s.columns, s.ring, 0, sum_of(s, z0 + d / v.subs, t));
        }
    }
};

} // namespace

void backproject_tiles(const Geometry& g, const std::vector<const float*>& images, float* f) {
    const Grid& grid = g.grid;
    const int deep = (grid.nz + depth - 1) / depth;
    const bool few =
        (grid.ny + stack * height - 1) / (stack * height) * deep < 2 * threads(); // tasks: make them smaller
    const int rows = few ? height : stack * height, across = (grid.ny + rows - 1) / rows;
    std::vector<Scratch> scratch(threads());
    parallel_tasks(int64_t(across) * deep, [&](int64_t number, int thread) {
        const int y0 = int(number / deep) * rows, part = int(number % deep);
        const Task task{g,
                        images,
                        f,
                        int(int64_t(grid.nz) * part / deep),
                        int(int64_t(grid.nz) * (part + 1) / deep),
                        y0,
                        std::min(grid.ny, y0 + rows)};
        task.run(scratch[thread]);
    });
}

} // namespace palpate
