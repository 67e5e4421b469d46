// The separable projector: each sub-slice is resampled onto the panel by two passes of short 1-D sums,
// A_k = path * sum of products W^y x W^x, and back by the same two passes with the weights read the other way.
//
// The result is made in tiles that stay in the first-level cache while all that adds to them is read: for a tile of a
// panel the slices, for a tile of a slice the views. The first pass resamples the rows of the source, for all moments
// at once; neighbouring results have neighbouring sources, so that a tap is one load and one shuffle of a vector, not
// a gather. The second adds whole rows.
#include "projector.h"
#include "buffer.h"
#include "parallel.h"
#include "passes.h"
#include "turned.h"
#include <algorithm>

namespace palpate {

namespace {

constexpr int stack = 4; // tiles of a panel, one above the other, that share their weights along x
constexpr int line = 16; // floats of a cache line
constexpr int soon = 8;  // rows of a panel to call for in advance

// What a thread needs, kept between its tasks.
struct Scratch {
    std::vector<Spans> rows;     // of the tile's rows: one a sub-slice and slice (of a view, or of all)
    std::vector<Shadow> shadows; // along x, likewise
    Columns columns;
    Ring ring;
    Buffer sum{Buffer(stack * height * width)};
    Buffer window, path; // backprojection: the parts of all panels under a tile
};

// Calls for rows of the slice to come, columns that pixels a0 to a1 will ask for: they lie too far apart for the
// hardware to foresee.
void await(const float* slice, const Grid& grid, const Spans& rows, const Shadow& x, int a0, int a1) {
    double low = grid.nx, high = 0;
    for (int face = 0; face < 2; face++) {
        low = std::min(low, (a0 - x.offset[face]) / x.slope[face]);
        high = std::max(high, (a1 - x.offset[face]) / x.slope[face]);
    }
    const int begin = std::max(0, int(low)), end = std::min(grid.nx, int(high) + 1);
    for (int64_t row = rows.begin; row < rows.end; row++)
        for (int column = begin; column < end + line - 1; column += line)
            __builtin_prefetch(slice + row * grid.nx + column, 0, 2);
}

// Scales a tile of a view's image by the rays' path and writes it to the measured pixels, or as it is to the fine ones
// of a tilted panel.
void write_tile(const View& v, const float* from, int b0, int b1, int a0, int columns, float* image) {
    for (int b = b0; b < b1; b++, from += width) {
        if (v.pose == Pose::tilted) {
            std::copy_n(from, columns, image + int64_t(b) * v.na + a0);
            continue;
        }
        float path[width];
        const int64_t first = v.start + b * v.step_b + a0 * v.step_a;
        v.path(first, v.step_a, columns, path);
        for (int a = 0; a < columns; a++) image[first + a * v.step_a] = from[a] * path[a];
    }
}

// Rows `b0` to b1 of a view's image, from all slices.
void project_strip(const Geometry& g, const View& v, const float* f, int b0, int b1, float* image, Scratch& s) {
    const Grid& grid = g.grid;
    const int slices = grid.nz * v.subs, tiles = (b1 - b0 + height - 1) / height;
    s.rows.resize(size_t(slices) * stack);
    s.shadows.resize(slices);
    for (int i = 0; i < slices; i++) {
        s.shadows[i] = shadow(g, v, i / v.subs, i % v.subs, Axis::x);
        const Shadow y = shadow(g, v, i / v.subs, i % v.subs, Axis::y);
        for (int t = 0; t < tiles; t++) {
            const int b = b0 + t * height;
            over_pixels(y, v.moments, b, std::min(height, b1 - b), grid.ny, s.rows[i * stack + t]);
            calm_pixels(v, s.rows[i * stack + t]);
        }
    }
    for (int a0 = 0; a0 < v.na; a0 += width) {
        const int a1 = std::min(v.na, a0 + width);
        std::fill(s.sum.begin(), s.sum.end(), 0.0f);
        for (int i = 0; i < slices; i++) {
            const float* slice = f + i / v.subs * grid.slice();
            if (i + 1 < slices && (i + 1) % v.subs == 0)
                for (int t = 0; t < tiles; t++)
                    if (s.rows[i * stack + t].reached)
                        await(slice + grid.slice(), grid, s.rows[i * stack + t], s.shadows[i + 1], a0, a1);
            over_pixels(s.shadows[i], v.moments, a0, a1 - a0, grid.nx, s.columns.spans);
            if (!s.columns.spans.reached) continue;
            s.columns.prepare(grid.nx);
            for (int t = 0; t < tiles; t++)
                if (s.rows[i * stack + t].reached)
                    add_slice({slice, grid.nx, grid.nx}, s.rows[i * stack + t], s.columns, s.ring,
                              &s.sum[t * height * width]);
        }
        for (int t = 0; t < tiles; t++) {
            const int b = b0 + t * height;
            write_tile(v, &s.sum[t * height * width], b, std::min(b1, b + height), a0, a1 - a0, image);
        }
    }
}

struct Strip {
    int view, begin, end;
};

// The views that the tiles serve: all but the turned ones.
void project_separable(const Geometry& g, const float* f, float* p) {
    const int views = int(g.views.size());
    std::vector<std::vector<float>> fine(views); // images of tilted panels, to be resampled
    std::vector<Strip> strips;                   // neighbours read the same rows of the volume
    int most = 0;
    for (int k = 0; k < views; k++) {
        const View& v = g.views[k];
        if (v.pose == Pose::tilted) fine[k].resize(size_t(v.na) * v.nb);
        if (v.pose != Pose::turned) most = std::max(most, v.nb);
    }
    for (int b = 0; b < most; b += stack * height)
        for (int k = 0; k < views; k++)
            if (g.views[k].pose != Pose::turned && b < g.views[k].nb)
                strips.push_back({k, b, std::min(g.views[k].nb, b + stack * height)});
    std::vector<Scratch> scratch(threads());
    parallel_tasks(int64_t(strips.size()), [&](int64_t task, int thread) {
        const auto [k, b0, b1] = strips[task];
        const View& v = g.views[k];
        project_strip(g, v, f, b0, b1, v.pose == Pose::tilted ? fine[k].data() : p + k * g.pixels(), scratch[thread]);
    });
    for (int k = 0; k < views; k++) {
        if (fine[k].empty()) continue;
        float* measured = p + k * g.pixels();
        apply(g.views[k].resampling.measured, fine[k].data(), measured);
        parallel(g.rows, [&](int64_t begin, int64_t end, int) {
            std::vector<float> path(g.columns);
            for (int64_t r = begin; r < end; r++) {
                g.views[k].path(r * g.columns, 1, g.columns, path.data());
                for (int c = 0; c < g.columns; c++) measured[r * g.columns + c] *= path[c];
            }
        });
    }
}

// Measured pixels of a tilted panel, scaled by path -> its fine parallel one.
void to_fine(const View& v, int64_t pixels, const float* p, std::vector<float>& image) {
    std::vector<float> scaled(pixels);
    for (int64_t row = 0; row < pixels; row += v.path.columns) v.path(row, 1, v.path.columns, &scaled[row]);
    for (int64_t i = 0; i < pixels; i++) scaled[i] *= p[i];
    image.resize(size_t(v.na) * v.nb);
    apply(v.resampling.fine, scaled.data(), image.data());
}

constexpr int padding = 2 * lanes; // columns beyond a window, so that whole vectors fit

// The part of a view's image under a tile: rows b0 to b1, columns a0 to a1, in s.window from `at` on. Where pixels are
// finer than voxels its rows are halved (see Columns): a0 is even, and the odd columns begin `jump` after the even
// ones.
struct Window {
    int b0, b1, a0, a1;
    size_t at;
    int64_t stride, jump;
};

void copy_window(const View& v, const float* p, const float* fine, const Window& w, Scratch& s) {
    const int columns = w.a1 - w.a0;
    if (int(s.path.size()) < 2 * columns) s.path.resize(2 * columns);
    float *path = s.path.data(), *halved = path + columns;
    for (int b = w.b0; b < w.b1; b++) {
        float* to = &s.window[w.at + (b - w.b0) * w.stride];
        float* whole = w.jump ? halved : to;
        if (fine) {
            std::copy_n(fine + int64_t(b) * v.na + w.a0, columns, whole);
        } else {
            const int64_t first = v.start + b * v.step_b + w.a0 * v.step_a;
            v.path(first, v.step_a, columns, path);
            for (int a = 0; a < columns + line - 1; a += line)
                __builtin_prefetch(p + first + soon * v.step_b + a * v.step_a, 0, 3);
            if (v.step_a == 1)
                for (int a = 0; a < columns; a++) whole[a] = p[first + a] * path[a];
            else
                for (int a = 0; a < columns; a++) whole[a] = p[first + a * v.step_a] * path[a];
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

constexpr int depth = 16; // slices of a task: the windows under them stay in the second-level cache

// Slices z0 to z1, rows y0 to y1, from all views.
struct Backprojection {
    const Geometry& g;
    const float* p;
    const std::vector<std::vector<float>>& fine;
    float* f;

    void strip(int z0, int z1, int y0, int y1, Scratch& s) const {
        const Grid& grid = g.grid;
        std::vector<size_t> rows_of(g.views.size() + 1, 0); // into s.rows
        for (size_t k = 0; k < g.views.size(); k++)
            rows_of[k + 1] = rows_of[k] + (g.views[k].pose == Pose::turned ? 0 : size_t(z1 - z0) * g.views[k].subs);
        s.rows.resize(rows_of.back());
        for (size_t k = 0; k < g.views.size(); k++) {
            const View& v = g.views[k];
            for (size_t i = rows_of[k]; i < rows_of[k + 1]; i++) {
                const int sub = int(i - rows_of[k]);
                under_voxels(shadow(g, v, z0 + sub / v.subs, sub % v.subs, Axis::y), v.moments, y0, y1 - y0, v.nb,
                             s.rows[i]);
                calm_voxels(v, y0, s.rows[i]);
            }
        }
        std::vector<Window> windows(g.views.size());
        for (int x0 = 0; x0 < grid.nx; x0 += width) {
            const int x1 = std::min(grid.nx, x0 + width);
            open_windows(z0, z1, x0, x1, rows_of, windows, s);
            for (int z = z0; z < z1; z++) {
                std::fill_n(s.sum.begin(), height * width, 0.0f);
                for (size_t k = 0; k < g.views.size(); k++)
                    if (windows[k].stride > 0) add_view(k, z, z - z0, x0, x1, rows_of[k], windows[k], s);
                for (int y = y0; y < y1; y++)
                    std::copy_n(&s.sum[(y - y0) * width], x1 - x0, f + z * grid.slice() + int64_t(y) * grid.nx + x0);
            }
        }
    }

    void open_windows(int z0, int z1, int x0, int x1, const std::vector<size_t>& rows_of, std::vector<Window>& windows,
                      Scratch& s) const {
        size_t size = 0;
        for (size_t k = 0; k < g.views.size(); k++) {
            const View& v = g.views[k];
            Window& w = windows[k];
            w = {v.nb, 0, v.na, 0, size, 0, 0};
            for (size_t i = rows_of[k]; i < rows_of[k + 1]; i++) {
                const Spans& rows = s.rows[i];
                if (!rows.reached) continue;
                w.b0 = std::min(w.b0, rows.begin);
                w.b1 = std::max(w.b1, rows.end);
                const int sub = int(i - rows_of[k]);
                const Shadow x = shadow(g, v, z0 + sub / v.subs, sub % v.subs, Axis::x);
                for (int face = 0; face < 2; face++) {
                    const double low = x.offset[face] + x.slope[face] * x0, high = x.offset[face] + x.slope[face] * x1;
                    w.a0 = std::min(w.a0, int(std::min(std::max(std::floor(low), 0.0), double(v.na))));
                    w.a1 = std::max(w.a1, int(std::min(std::max(std::ceil(high), 0.0), double(v.na))));
                }
            }
            if (w.b0 >= w.b1 || w.a0 >= w.a1) continue;
            if (shadow(g, v, z0, 0, Axis::x).slope[0] > 1) { // eight voxels shadow more than eight pixels
                w.a0 -= w.a0 % 2;
                w.jump = ((w.a1 - w.a0 + 1) / 2 + padding + lanes - 1) / lanes * lanes;
                w.stride = 2 * w.jump;
            } else {
                w.stride = (w.a1 - w.a0 + padding + lanes - 1) / lanes * lanes;
            }
            size += (w.b1 - w.b0) * w.stride;
        }
        if (s.window.size() < size) s.window.resize(size);
        for (size_t k = 0; k < g.views.size(); k++)
            if (windows[k].stride > 0)
                copy_window(g.views[k], p + k * g.pixels(), fine[k].empty() ? nullptr : fine[k].data(), windows[k], s);
    }

    void add_view(size_t k, int z, int dz, int x0, int x1, size_t rows, const Window& w, Scratch& s) const {
        const View& v = g.views[k];
        for (int sub = 0; sub < v.subs; sub++) {
            const Spans& y = s.rows[rows + size_t(dz) * v.subs + sub];
            if (!y.reached) continue;
            under_voxels(shadow(g, v, z, sub, Axis::x), v.moments, x0, x1 - x0, v.na, s.columns.spans);
            if (!s.columns.spans.reached) continue;
            // Pixel (0, 0) of the image, were the window all of it.
            const float* image = s.window.data() + w.at - w.b0 * w.stride - (w.jump ? w.a0 / 2 : w.a0);
            const int end = int(w.jump ? w.a0 / 2 + w.jump : w.a0 + w.stride);
            w.jump ? s.columns.prepare_halved(end, w.jump) : s.columns.prepare(end);
            const Source source{image, w.stride, end};
            add_slice(source, y, s.columns, s.ring, s.sum.data());
        }
    }
};

// Writes all of f, with what those views add to it.
void backproject_separable(const Geometry& g, const float* p, float* f) {
    const int views = int(g.views.size());
    const Grid& grid = g.grid;
    std::vector<std::vector<float>> fine(views);
    parallel_tasks(views, [&](int64_t k, int) {
        if (g.views[k].pose == Pose::tilted) to_fine(g.views[k], g.pixels(), p + k * g.pixels(), fine[k]);
    });
    const int across = (grid.ny + height - 1) / height, deep = (grid.nz + depth - 1) / depth;
    const Backprojection back{g, p, fine, f};
    std::vector<Scratch> scratch(threads());
    parallel_tasks(int64_t(across) * deep, [&](int64_t task, int thread) {
        const int y0 = int(task / deep) * height, part = int(task % deep);
        back.strip(int(int64_t(grid.nz) * part / deep), int(int64_t(grid.nz) * (part + 1) / deep), y0,
                   std::min(grid.ny, y0 + height), scratch[thread]);
    });
}

// Each slice with x and y exchanged, for views that see it so.
void exchange(const float* in, int nz, int ny, int nx, bool add, float* out) {
    parallel(nz, [&](int64_t begin, int64_t end, int) {
        for (int64_t z = begin; z < end; z++)
            for (int y = 0; y < ny; y++)
                for (int x = 0; x < nx; x++) {
                    float& to = out[(z * nx + x) * ny + y];
                    to = (add ? to : 0) + in[(z * ny + y) * nx + x];
                }
    });
}

bool any_swapped(const Geometry& g) {
    return std::any_of(g.views.begin(), g.views.end(), [](const View& v) { return v.swapped; });
}

} // namespace

void project(const Geometry& g, const float* f, float* p) {
    const Grid& grid = g.grid;
    project_separable(g, f, p);
    std::vector<float> image, exchanged;
    if (any_swapped(g)) {
        exchanged.resize(grid.nz * grid.slice());
        exchange(f, grid.nz, grid.ny, grid.nx, false, exchanged.data());
    }
    for (size_t k = 0; k < g.views.size(); k++) {
        const View& v = g.views[k];
        if (v.pose != Pose::turned) continue;
        float* measured = p + k * g.pixels();
        image.resize(size_t(v.nb) * v.na);
        project_turned(g, v, v.swapped ? exchanged.data() : f, image.data());
        parallel(v.nb, [&](int64_t begin, int64_t end, int) {
            std::vector<float> path(v.na);
            for (int64_t b = begin; b < end; b++) {
                const int64_t first = v.start + b * v.step_b;
                v.path(first, v.step_a, v.na, path.data());
                for (int64_t a = 0; a < v.na; a++) measured[first + a * v.step_a] = image[b * v.na + a] * path[a];
            }
        });
    }
}

void backproject(const Geometry& g, const float* p, float* f) {
    const Grid& grid = g.grid;
    backproject_separable(g, p, f);
    std::vector<float> image, exchanged(any_swapped(g) ? grid.nz * grid.slice() : 0, 0.0f);
    for (size_t k = 0; k < g.views.size(); k++) {
        const View& v = g.views[k];
        if (v.pose != Pose::turned) continue;
        image.resize(size_t(v.nb) * v.na);
        parallel(v.nb, [&](int64_t begin, int64_t end, int) {
            std::vector<float> path(v.na);
            for (int64_t b = begin; b < end; b++) {
                const int64_t first = v.start + b * v.step_b;
                v.path(first, v.step_a, v.na, path.data());
                for (int64_t a = 0; a < v.na; a++)
                    image[b * v.na + a] = p[k * g.pixels() + first + a * v.step_a] * path[a];
            }
        });
        backproject_turned(g, v, image.data(), v.swapped ? exchanged.data() : f);
    }
    if (!exchanged.empty()) exchange(exchanged.data(), grid.nz, grid.nx, grid.ny, true, f);
}

} // namespace palpate
