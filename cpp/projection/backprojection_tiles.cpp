// Back projection of the separable views, in tiles of the volume. The tiles of a few slices stay in the second-level
// cache while one view after the other adds to them. The part of its image that they read, scaled by the rays' path,
// stays in the first-level cache meanwhile.
#include "projection/backprojection_tiles.h"
#include "base/aligned_buffer.h"
#include "base/streaming_store.h"
#include "base/thread_pool.h"
#include "projection/ray_lengths.h"
#include "projection/separable_passes.h"
#include "projection/separable_passes_avx512.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int stack = 2;             // tiles along y that share their weights along x
constexpr int depth = 16;            // slices of a task, at most
constexpr int prefetch_rows = 8;     // of a panel
constexpr int padding = avx512_span; // columns after a window, so that whole vectors can be read

// The part of a view's image that a task reads: rows b0 .. b1 - 1, columns a0 .. a1 - 1. If pixels are finer than
// voxels, its rows are deinterleaved (see ColumnWeights): a0 is even, and the odd columns follow `odd_offset` after
// the even ones.
struct Window {
    int b0, b1, a0, a1;
    int64_t stride, odd_offset;

    bool empty() const { return b0 >= b1 || a0 >= a1; }
    // Pixel (0, 0) of the image, as if the window held all of it, and where its columns end.
    SourceRows source(const float* values) const {
        const int from = odd_offset ? a0 / 2 : a0;
        return {values - b0 * stride - from, stride, int(from + (odd_offset ? odd_offset : stride))};
    }
};

// A thread's memory, kept between its tasks.
struct Scratch {
    std::vector<TileWeights> rows;           // of the task's rows: per view, sub-slice, tile of the stack
    std::vector<EdgeProjection> projections; // along x: per view, sub-slice
    ColumnWeights columns;
    RowBuffer buffer;
    AlignedBuffer sum; // per slice, tile of the stack
    AlignedBuffer window, row;
    RayLengths lengths;
};

void copy_window(const View& v, const float* image, const Window& w, Scratch& s) {
    const int columns = w.a1 - w.a0;
    const size_t size = (w.b1 - w.b0) * w.stride;
    if (s.window.size() < size) s.window.resize(size);
    if (int(s.row.size()) < columns) s.row.resize(columns);
    if (v.orientation != PanelOrientation::oblique) s.lengths.make(v, w.a0, columns, w.b0, w.b1);
    for (int b = w.b0; b < w.b1; b++) {
        float* to = &s.window[(b - w.b0) * w.stride];
        float* whole = w.odd_offset ? s.row.data() : to;
        if (v.orientation == PanelOrientation::oblique) {
            std::copy_n(image + int64_t(b) * v.na + w.a0, columns, whole);
        } else {
            const float* from = image + v.start + b * v.step_b + w.a0 * v.step_a;
            for (int a = 0; a < columns + cache_line - 1; a += cache_line)
                __builtin_prefetch(from + prefetch_rows * v.step_b + a * v.step_a, 0, 3);
            if (v.step_a != 1) {
                for (int a = 0; a < columns; a++) whole[a] = from[a * v.step_a];
                from = whole;
            }
            s.lengths.scale(b, from, whole);
        }
        if (w.odd_offset) {
            const int odd = columns / 2, even = columns - odd;
            for (int a = 0; a < odd; a++) to[a] = whole[2 * a], to[w.odd_offset + a] = whole[2 * a + 1];
            if (even > odd) to[odd] = whole[2 * odd];
            std::fill(to + even, to + w.odd_offset, 0.0f);
            std::fill(to + w.odd_offset + odd, to + w.stride, 0.0f);
        } else {
            std::fill(to + columns, to + w.stride, 0.0f);
        }
    }
}

// Slices z0 to z1, rows y0 to y1 (`stack` tiles at most), from all views.
struct Task {
    const ScanGeometry& g;
    const std::vector<const float*>& images;
    float* f;
    const int z0, z1, y0, y1;

    int tiles() const { return (y1 - y0 + tile_rows - 1) / tile_rows; }
    int subslices(size_t k) const { return images[k] ? (z1 - z0) * g.views[k].subslices : 0; }
    float* sum_of(Scratch& s, int z, int t) const { return &s.sum[((z - z0) * stack + t) * tile_rows * tile_columns]; }

    void run(Scratch& s) const {
        std::vector<size_t> first(g.views.size() + 1, 0); // sub-slice of each view, in s.rows and s.shadows
        for (size_t k = 0; k < g.views.size(); k++) first[k + 1] = first[k] + subslices(k);
        if (s.rows.size() < first.back() * stack) s.rows.resize(first.back() * stack);
        s.projections.resize(first.back());
        s.sum.resize((z1 - z0) * stack * tile_rows * tile_columns);
        for (size_t k = 0; k < g.views.size(); k++) make_row_weights(k, first[k], s);
        for (int x0 = 0; x0 < g.grid.nx; x0 += tile_columns) {
            const int x1 = std::min(g.grid.nx, x0 + tile_columns);
            std::fill(s.sum.begin(), s.sum.end(), 0.0f);
            for (size_t k = 0; k < g.views.size(); k++)
                if (images[k]) add_view(k, first[k], x0, x1, s);
            for (int z = z0; z < z1; z++)
                for (int y = y0; y < y1; y++) {
                    float* to = f + (int64_t(z) * g.grid.ny + y) * g.grid.nx + x0;
                    streaming_copy(sum_of(s, z, 0) + (y - y0) * tile_columns, x1 - x0, to);
                }
        }
        streaming_fence();
    }

private:
    void make_row_weights(size_t k, size_t first, Scratch& s) const {
        const View& v = g.views[k];
        for (int d = 0; d < subslices(k); d++) {
            const int z = z0 + d / v.subslices, sub = d % v.subslices;
            s.projections[first + d] = project_edges(g, v, z, sub, Axis::x);
            const EdgeProjection along = project_edges(g, v, z, sub, Axis::y);
            for (int t = 0; t < tiles(); t++) {
                TileWeights& rows = s.rows[(first + d) * stack + t];
                const int y = y0 + t * tile_rows;
                backprojection_weights(along, v.moments, y, std::min(tile_rows, y1 - y), g.grid.ny, v.nb, rows);
                drop_moments_of_voxels(v, y, rows);
            }
        }
    }

    Window window(size_t k, size_t first, int x0, int x1, const Scratch& s) const {
        const View& v = g.views[k];
        Window w = {v.nb, 0, v.na, 0, 0, 0};
        for (int d = 0; d < subslices(k); d++) {
            bool nonempty = false;
            for (int t = 0; t < tiles(); t++) {
                const TileWeights& rows = s.rows[(first + d) * stack + t];
                if (!rows.nonempty) continue;
                nonempty = true;
                w.b0 = std::min(w.b0, rows.begin);
                w.b1 = std::max(w.b1, rows.end);
            }
            const EdgeProjection& x = s.projections[first + d];
            for (int face = 0; face < 2 && nonempty; face++) {
                const double low = x.offset[face] + x.slope[face] * x0, high = x.offset[face] + x.slope[face] * x1;
                w.a0 = std::min(w.a0, int(std::min(std::max(std::floor(low), 0.0), double(v.na))));
                w.a1 = std::max(w.a1, int(std::min(std::max(std::ceil(high), 0.0), double(v.na))));
            }
        }
        if (w.empty()) return w;
        const double slope = s.projections[first].slope[0];
        if (slope > 1 && !(avx512_allowed() && 20 * slope < avx512_span)) { // eight voxels cover more than eight pixels
            w.a0 -= w.a0 % 2;
            w.odd_offset = ((w.a1 - w.a0 + 1) / 2 + padding + lanes - 1) / lanes * lanes;
            w.stride = 2 * w.odd_offset;
        } else {
            // The AVX-512 pass needs no padding: its sixteen columns may begin further left instead.
            const int columns = avx512_allowed() ? std::max(w.a1 - w.a0, avx512_span) : w.a1 - w.a0 + padding;
            w.stride = (columns + lanes - 1) / lanes * lanes;
        }
        return w;
    }

    void add_view(size_t k, size_t first, int x0, int x1, Scratch& s) const {
        const View& v = g.views[k];
        const Window w = window(k, first, x0, x1, s);
        if (w.empty()) return;
        copy_window(v, images[k], w, s);
        const SourceRows source = w.source(s.window.data());
        for (int d = 0; d < subslices(k); d++) {
            const TileWeights* rows = &s.rows[(first + d) * stack];
            const int moments = max_moments_of(rows, tiles());
            if (moments == 0) continue;
            backprojection_weights(s.projections[first + d], moments, x0, x1 - x0, g.grid.nx, v.na, s.columns.weights);
            if (!s.columns.weights.nonempty) continue;
            w.odd_offset ? s.columns.prepare_deinterleaved(source.columns, w.odd_offset)
                         : s.columns.prepare(source.columns, avx512_allowed());
            for (int t = 0; t < tiles(); t++) {
                float* sum = sum_of(s, z0 + d / v.subslices, t);
                if (rows[t].nonempty && !add_subslice_avx512(source, rows[t], s.columns, 0, sum))
                    add_subslice(source, rows[t], s.columns, s.buffer, sum);
            }
        }
    }
};

} // namespace

void backproject_tiles(const ScanGeometry& g, const std::vector<const float*>& images, float* f) {
    const Grid& grid = g.grid;
    const int deep = (grid.nz + depth - 1) / depth;
    const bool few =
        (grid.ny + stack * tile_rows - 1) / (stack * tile_rows) * deep < 2 * threads(); // tasks: make them smaller
    const int rows = few ? tile_rows : stack * tile_rows, across = (grid.ny + rows - 1) / rows;
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
