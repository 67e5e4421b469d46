// On a rotated panel the columns of the image are separable, since x and z of a ray depend on its column alone. Along
// y the magnification differs by column, so that no weight is used twice: weights are computed where they are used,
// eight columns at once. As on parallel panels, tiles of the result stay in the nearest cache.
#include "projection/rotated_panel.h"
#include "base/thread_pool.h"
#include "projection/rotated_panel_passes.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr int tiles_across = tile_size / rotated_tile_columns,
              tiles_down = 2; // tiles across and down in a task of the projection

constexpr int task_rows = 8, depth = 8;      // rows of voxels, and slices, of a task of the backprojection
constexpr int strip_columns = 2 * tile_size; // voxels along x whose columns fit into the nearest cache

std::vector<ColumnTable> tables(const ScanGeometry& g, const View& v, bool of_pixels) {
    std::vector<ColumnTable> out(size_t(g.grid.nz) * v.subslices);
    parallel(int64_t(out.size()), [&](int64_t begin, int64_t end, int) {
        for (int64_t slab = begin; slab < end; slab++)
            of_pixels ? forward_column_weights(g, v, int(slab), out[slab])
                      : backprojection_column_weights(g, v, int(slab), out[slab]);
    });
    return out;
}

std::vector<RowEdges> all_edges(const ScanGeometry& g, const View& v) {
    std::vector<RowEdges> out;
    for (int i = 0; i < g.grid.nz * products(v); i++) out.push_back(row_edges(g, v, i / products(v), i % products(v)));
    return out;
}

// Rows b0 to b1 and columns a0 to a1 of a view's image.
struct Tile {
    int b0, b1, a0, a1;
    // The rows of voxels, low .. high - 1, that project onto it at some Gauss point.
    void rows(const RowEdges* edges, int points, int ny, int& low, int& high) const {
        double least = 1e300, most = -1e300;
        for (int m = 0; m < points; m++)
            for (int a : {a0, a1 - 1}) {
                const double per = 1 / (edges[m].slope + a * edges[m].slope_step), at = edges[m].at(0, a);
                least = std::min(least, (b0 - at) * per);
                most = std::max(most, (b1 - at) * per);
            }
        low = int(std::min(std::max(std::floor(least), 0.0), double(ny)));
        high = int(std::min(std::max(std::ceil(most), 0.0), double(ny)));
    }
};

class Projection {
    const ScanGeometry& g;
    const View& v;
    const Grid grid;
    const float* f;
    const std::vector<ColumnTable> x = tables(g, v, true);
    const std::vector<RowEdges> y = all_edges(g, v);

public:
    struct Scratch {
        AlignedBuffer rows, sum{AlignedBuffer(tiles_across * tiles_down * tile_rows * rotated_tile_columns)};
    };

    Projection(const ScanGeometry& g, const View& v, const float* f) : g(g), v(v), grid(g.seen_by(v)), f(f) {}

    // Projects onto the pixels of a task, which begin at (b0, a0).
    void task(int b0, int a0, float* image, Scratch& s) const {
        std::fill(s.sum.begin(), s.sum.end(), 0.0f);
        for (int slab = 0; slab < int(x.size()); slab++) {
            if (x[slab].taps_of(a0) == 0) continue;
            for (int k = 0; k < tiles_across * tiles_down; k++) {
                const Tile t = tile(b0, a0, k);
                if (t.b0 < t.b1 && t.a0 < t.a1) add(slab, t, s, &s.sum[k * tile_rows * rotated_tile_columns]);
            }
        }
        for (int k = 0; k < tiles_across * tiles_down; k++) {
            const Tile t = tile(b0, a0, k);
            for (int b = t.b0; b < t.b1 && t.a0 < t.a1; b++)
                std::copy_n(&s.sum[(k * tile_rows + b - t.b0) * rotated_tile_columns], t.a1 - t.a0,
                            image + int64_t(b) * v.na + t.a0);
        }
    }

private:
    Tile tile(int b0, int a0, int k) const {
        const int b = b0 + k / tiles_across * tile_rows, a = a0 + k % tiles_across * rotated_tile_columns;
        return {b, std::min(v.nb, b + tile_rows), a, std::min(v.na, a + rotated_tile_columns)};
    }

    // Prefetches the rows of the next slice: they lie too far apart for the hardware to predict.
    void prefetch_next_slice(int slab, const Tile& t, int low, int high) const {
        const int next = slab + v.subslices;
        if (next >= int(x.size())) return;
        const float* slice = f + next / v.subslices * grid.slice();
        const int begin = x[next].first[t.a0], end = x[next].first[t.a1 - 1] + x[next].taps_of(t.a0);
        for (int64_t row = low; row < high; row++)
            for (int column = begin; column < end + cache_line - 1; column += cache_line)
                __builtin_prefetch(slice + row * grid.nx + column, 0, 2);
    }

    void add(int slab, const Tile& t, Scratch& s, float* sum) const {
        const int points = v.moments;
        const RowEdges* e = &y[slab * points];
        int low, high, taps = 0;
        t.rows(e, points, grid.ny, low, high);
        if (low >= high) return;
        prefetch_next_slice(slab, t, low, high);
        for (int m = 0; m < points; m++)
            for (int a = t.a0; a < t.a1; a += lanes)
                taps = std::max(taps, voxels_over(e[m], ColumnOctet(a, v.na - 1), t.b0, t.b1));
        const int begin = low - taps, count = high - low + 2 * taps; // outside the grid all is 0
        const int64_t point_size = int64_t(count) * rotated_tile_columns;
        if (int64_t(s.rows.size()) < points * point_size) s.rows.resize(points * point_size);
        for (int m = 0; m < points; m++) {
            std::fill_n(&s.rows[m * point_size], taps * rotated_tile_columns, 0.0f);
            std::fill_n(&s.rows[m * point_size + (count - taps) * rotated_tile_columns], taps * rotated_tile_columns,
                        0.0f);
        }
        resample(slab, t, low, high, point_size, &s.rows[taps * rotated_tile_columns]);
        VoxelPositions places;
        for (int a = t.a0; a < t.a1; a += lanes) {
            const ColumnOctet columns(a, v.na - 1);
            for (int m = 0; m < points; m++) find_voxels(e[m], columns, t.b0, t.b1 - t.b0, begin, high, m, places);
            add_voxels(&s.rows[a - t.a0], point_size, places, e, columns, points, taps, begin, t.b1 - t.b0,
                       sum + a - t.a0);
        }
    }

    // Resamples rows of voxels low .. high - 1 onto the tile's columns.
    void resample(int slab, const Tile& t, int low, int high, int64_t point_size, float* out) const {
        const ColumnTable& table = x[slab];
        const float* from = f + slab / v.subslices * grid.slice() + int64_t(low) * grid.nx;
        const int taps = table.taps_of(t.a0);
        for (int a = t.a0; a < t.a1; a += lanes) {
            const int32_t* first = &table.first[a];
            const float* weight = table.of(a, v.moments);
            const ShufflePattern reach(first, taps, grid.nx);
            if (reach.vectors == ShufflePattern::each)
                gather_voxels(from, grid.nx, high - low, first, v.moments, weight, taps, point_size, out + a - t.a0);
            else
                resample_voxels(from, grid.nx, high - low, reach, v.moments, weight, taps, point_size, out + a - t.a0);
        }
    }
};

class Backprojection {
    const ScanGeometry& g;
    const View& v;
    const Grid grid;
    const int64_t stride; // of the image, with columns of 0 behind it up to an odd number of cache lines (neighbouring
                          // rows would else compete for their place), and rows of 0 above and below it
    int taps = 0;         // most pixels under a voxel
    const std::vector<ColumnTable> x = tables(g, v, false);
    const std::vector<RowEdges> y = all_edges(g, v);
    AlignedBuffer padded;

public:
    struct Scratch {
        AlignedBuffer columns, sum{AlignedBuffer(task_rows * tile_size)};
    };

    Backprojection(const ScanGeometry& g, const View& v, const float* image)
        : g(g), v(v), grid(g.seen_by(v)), stride((v.na + cache_line - 1) / cache_line * cache_line | cache_line) {
        for (const RowEdges& e : y) taps = std::max(taps, pixels_under(e, grid.ny, v.na));
        padded.assign((v.nb + 2 * taps) * stride, 0.0f);
        parallel(v.nb, [&](int64_t begin, int64_t end, int) {
            for (int64_t b = begin; b < end; b++) std::copy_n(image + b * v.na, v.na, &padded[(taps + b) * stride]);
        });
    }

    // Adds to rows y0 to y1 of slices z0 to z1.
    void task(int z0, int z1, int y0, int y1, float* f, Scratch& s) const {
        s.columns.resize(std::max(int64_t(s.columns.size()), v.moments * task_rows * stride));
        for (int slab = z0 * v.subslices; slab < z1 * v.subslices; slab++)
            for (int x0 = 0; x0 < grid.nx; x0 += strip_columns)
                add(slab, x0, std::min(grid.nx, x0 + strip_columns), y0, y1, f + slab / v.subslices * grid.slice(), s);
    }

private:
    void add(int slab, int x0, int x1, int y0, int y1, float* slice, Scratch& s) const {
        const ColumnTable& table = x[slab];
        int low = v.na, end = 0;
        for (int begin = x0; begin < x1; begin += tile_size) {
            if (table.taps_of(begin) == 0) continue;
            low = std::min(low, table.first[begin]);
            end = std::max(end, table.first[std::min(x1, begin + tile_size) - 1] + table.taps_of(begin));
        }
        if (low >= end) return;
        const int a0 = low / column_pair * column_pair,
                  a1 = std::min((v.na + column_pair - 1) / column_pair * column_pair,
                                (end + 2 * column_pair - 1) / column_pair * column_pair);
        const int64_t pitch = a1 - a0, point_size = task_rows * pitch;
        for (int row = y0; row < y1; row++)
            for (int column = x0; column < x1; column += cache_line)
                __builtin_prefetch(slice + int64_t(row) * grid.nx + column, 1, 2);
        for (int m = 0; m < v.moments; m++) {
            const RowEdges& e = y[slab * v.moments + m];
            for (int row = y0; row < y1; row++)
                add_pixels(e, row, taps, v.nb, &padded[taps * stride], stride, a0, a1,
                           &s.columns[m * point_size + (row - y0) * pitch]);
        }
        for (int begin = x0; begin < x1; begin += tile_size) {
            const int n = std::min(tile_size, x1 - begin), support = table.taps_of(begin);
            if (support == 0) continue;
            for (int i = 0; i < n; i += lanes) {
                int32_t first[lanes];
                for (int j = 0; j < lanes; j++) first[j] = table.first[begin + i + j] - a0;
                resample_points(s.columns.data(), pitch, point_size, y1 - y0, first, int(pitch), v.moments,
                                table.of(begin + i, v.moments), support, &s.sum[i]);
            }
            for (int row = y0; row < y1; row++) {
                float* to = slice + int64_t(row) * grid.nx + begin;
                const float* from = &s.sum[(row - y0) * tile_size];
                for (int i = 0; i < n; i++) to[i] += from[i];
            }
        }
    }
};

} // namespace

void project_rotated(const ScanGeometry& g, const View& v, const float* f, float* image) {
    const Projection projection(g, v, f);
    const int across = (v.na + tiles_across * rotated_tile_columns - 1) / (tiles_across * rotated_tile_columns),
              down = (v.nb + tiles_down * tile_rows - 1) / (tiles_down * tile_rows);
    std::vector<Projection::Scratch> scratch(threads());
    parallel_tasks(int64_t(across) * down, [&](int64_t task, int thread) {
        projection.task(int(task) / across * tiles_down * tile_rows,
                        int(task) % across * tiles_across * rotated_tile_columns, image, scratch[thread]);
    });
}

void backproject_rotated(const ScanGeometry& g, const View& v, const float* image, float* f) {
    const Grid grid = g.seen_by(v);
    const Backprojection back(g, v, image);
    const int across = (grid.ny + task_rows - 1) / task_rows, layers = (grid.nz + depth - 1) / depth;
    std::vector<Backprojection::Scratch> scratch(threads());
    parallel_tasks(int64_t(across) * layers, [&](int64_t task, int thread) {
        const int z0 = int(task) / across * depth, y0 = int(task) % across * task_rows;
        back.task(z0, std::min(grid.nz, z0 + depth), y0, std::min(grid.ny, y0 + task_rows), f, scratch[thread]);
    });
}

} // namespace palpate
