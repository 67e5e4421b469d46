// Forward projection of the separable views, in tiles that stay in the second-level cache while all slices add to
// them. The volume's middle slice is cut into blocks, and each panel along the projections of their edges: the tiles
// of several views under one block then read nearly the same voxels, which come from memory once for all of them.
#include "projection/forward_tiles.h"
#include "base/aligned_buffer.h"
#include "base/thread_pool.h"
#include "projection/ray_lengths.h"
#include "projection/separable_passes.h"
#include "projection/separable_passes_avx512.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int tiles_per_view = 2;     // side by side: more of each memory page of the volume is used
constexpr int max_views = 5;          // whose tiles, and the slab that they read, fit into the cache
constexpr int max_stack = 4;          // tiles along y that share their weights along x
constexpr int slab_tiles = 8;         // slices of a slab, times the tiles of a stack
constexpr int max_row_weights = 4096; // tiles and sub-slices whose weights along y are kept: 10 MB
constexpr int tasks_per_thread = 4;   // so that no thread waits long for another
constexpr int prefetch_rows = 8;      // of a panel

// Blocks along one axis of the middle slice: block i reaches from voxel edge i * step to edge (i + 1) * step, and its
// projection has at most `size` pixels.
class Blocks {
    double step = HUGE_VAL;
    std::vector<EdgeProjection> middle; // per view, of the slice in the middle

public:
    int begin = INT32_MAX, end = INT32_MIN;

    Blocks(const ScanGeometry& g, const std::vector<int>& views, Axis axis, int size) {
        for (int k : views) {
            middle.push_back(project_edges(g, g.views[k], g.grid.nz / 2, 0, axis));
            step = std::min(step, (size - 0.01) / middle.back().slope[0]);
        }
        for (size_t i = 0; i < views.size(); i++) {
            const View& v = g.views[views[i]];
            const double pixels = axis == Axis::x ? v.na : v.nb, scale = 1 / (middle[i].slope[0] * step);
            begin = std::min(begin, int(std::floor(-middle[i].offset[0] * scale)));
            end = std::max(end, int(std::ceil((pixels - middle[i].offset[0]) * scale)));
        }
    }
    int size() const { return end - begin; }
    // The first pixel of block `number` in the i-th of these views.
    int edge(size_t i, int number, int pixels) const {
        const double at = std::round(middle[i].offset[0] + middle[i].slope[0] * step * number);
        return number == begin ? 0 : number == end ? pixels : int(std::min(std::max(at, 0.0), double(pixels)));
    }
};

// Writes a tile of a view's image, or adds it: to the measured pixels, scaled by the rays' lengths, or on an oblique
// panel to the fine pixels, not scaled.
void write_tile(const View& v, const RayLengths& lengths, const float* from, int b0, int b1, int a0, int columns,
                bool add, float* image) {
    const bool direct = v.step_a == 1 && !add;
    for (int b = b0; b < b1; b++, from += tile_columns) {
        if (v.orientation == PanelOrientation::oblique) {
            std::copy_n(from, columns, image + int64_t(b) * v.na + a0);
            continue;
        }
        float scaled[tile_columns];
        float* first = image + v.start + b * v.step_b + a0 * v.step_a;
        for (int a = 0; a < columns + cache_line - 1 && v.step_a == 1; a += cache_line)
            __builtin_prefetch(first + prefetch_rows * v.step_b + a, 1, 3);
        lengths.scale(b, from, direct ? first : scaled);
        if (direct) continue;
        for (int a = 0; a < columns; a++) {
            float& pixel = first[a * v.step_a];
            pixel = (add ? pixel : 0) + scaled[a];
        }
    }
}

struct Tile {
    int b0, b1, a0, a1;
    bool empty() const { return b0 >= b1 || a0 >= a1; }
};

// A thread's memory, kept between its tasks.
struct Scratch {
    std::vector<TileWeights> rows;      // of a strip
    std::vector<ColumnWeights> columns; // per sub-slice of a slab
    RowBuffer buffer;
    AlignedBuffer sum;
    RayLengths lengths;
};

// How many tiles of a view form a stack along y. They share their weights along x, which matters most with one
// product a slice; but the slab that they read grows with the stack.
int stack_size(const ScanGeometry& g, const std::vector<int>& views) {
    const bool single_product =
        std::all_of(views.begin(), views.end(), [&](int k) { return products(g.views[k]) == 1; });
    return single_product ? max_stack : max_stack / 2;
}

class Forward {
    const ScanGeometry& g;
    const float* f;
    const std::vector<float*>& images;
    const bool add;
    std::vector<int> views;                               // of one group
    std::vector<std::vector<EdgeProjection>> projections; // along x; per view, per sub-slice
    std::vector<size_t> rows_of{0};                       // where each view's begin among the rows of a strip
    const int stack, slab;                                // tiles one above the other; slices

    int depth(size_t i) const { return g.grid.nz * g.views[views[i]].subslices; }
    float* sum_of(Scratch& s, size_t number, int t) const {
        return &s.sum[(number * stack + t) * tile_rows * tile_columns];
    }

public:
    const Blocks across, along;

    Forward(const ScanGeometry& g, const float* f, const std::vector<float*>& images, bool add,
            const std::vector<int>& views)
        : g(g), f(f), images(images), add(add), views(views), stack(stack_size(g, views)), slab(slab_tiles / stack),
          across(g, views, Axis::x, tile_columns), along(g, views, Axis::y, stack * tile_rows) {
        for (int k : views) {
            const View& v = g.views[k];
            rows_of.push_back(rows_of.back() + size_t(g.grid.nz) * v.subslices * stack);
            projections.emplace_back();
            for (int i = 0; i < g.grid.nz * v.subslices; i++)
                projections.back().push_back(project_edges(g, v, i / v.subslices, i % v.subslices, Axis::x));
        }
    }

    // The weights along y of row `down` of blocks, which project_strip reads: how many there are, and those of the
    // i-th view, ordered by slice, sub-slice and tile of the stack.
    size_t rows() const { return rows_of.back(); }
    void make_row_weights(int down, size_t i, TileWeights* rows) const {
        const View& v = g.views[views[i]];
        const int b0 = along.edge(i, down, v.nb), b1 = along.edge(i, down + 1, v.nb);
        TileWeights* out = rows + rows_of[i];
        for (int d = 0; d < depth(i); d++) {
            const EdgeProjection y = project_edges(g, v, d / v.subslices, d % v.subslices, Axis::y);
            for (int t = 0; t < stack; t++, out++) {
                const int b = b0 + t * tile_rows, count = std::min(tile_rows, b1 - b);
                out->nonempty = false;
                if (count <= 0) continue;
                forward_weights(y, v.moments, b, count, g.grid.ny, *out);
                drop_moments_of_pixels(v, *out);
            }
        }
    }

    // Projects the tiles of blocks first .. last - 1 of row `down` of blocks.
    void project_strip(int down, int first, int last, const TileWeights* rows, Scratch& s) const {
        s.sum.resize(views.size() * tiles_per_view * stack * tile_rows * tile_columns);
        std::vector<Tile> tiles(views.size() * tiles_per_view);
        for (int block = first; block < last; block += tiles_per_view) {
            for (size_t n = 0; n < tiles.size(); n++) {
                const size_t i = n / tiles_per_view;
                const View& v = g.views[views[i]];
                const int number = std::min(block + int(n % tiles_per_view), last);
                tiles[n] = {along.edge(i, down, v.nb), along.edge(i, down + 1, v.nb), across.edge(i, number, v.na),
                            across.edge(i, std::min(number + 1, last), v.na)};
            }
            if (std::all_of(tiles.begin(), tiles.end(), [](const Tile& t) { return t.empty(); })) continue;
            std::fill(s.sum.begin(), s.sum.end(), 0.0f);
            // Slab by slab: a slab stays in the second-level cache for all views while they prefetch the next one.
            for (int z = 0; z < g.grid.nz; z += slab)
                for (size_t n = 0; n < tiles.size(); n++)
                    if (!tiles[n].empty())
                        add_slab(n, z, std::min(g.grid.nz, z + slab), tiles[n], rows + rows_of[n / tiles_per_view], s);
            for (size_t n = 0; n < tiles.size(); n++) write_tiles(n, tiles[n], s);
        }
    }

private:
    void write_tiles(size_t n, const Tile& tile, Scratch& s) const {
        if (tile.empty()) return;
        const int k = views[n / tiles_per_view], columns = tile.a1 - tile.a0;
        s.lengths.make(g.views[k], tile.a0, columns, tile.b0, tile.b1);
        for (int t = 0, b = tile.b0; b < tile.b1; t++, b += tile_rows)
            write_tile(g.views[k], s.lengths, sum_of(s, n, t), b, std::min(tile.b1, b + tile_rows), tile.a0, columns,
                       add, images[k]);
    }

    // The distance, in floats, from what a tile reads of slices z0 .. z1 - 1 to what it reads next, in the next slab
    // or for the next block; approximate.
    int64_t prefetch_distance_of(size_t i, int z0, int z1, const Tile& tile, const TileWeights* rows) const {
        const bool last = z1 == g.grid.nz;
        const int subslices = g.views[views[i]].subslices, here = z0 * subslices, there = last ? 0 : z1 * subslices;
        const auto voxel = [&](int d, int a) { return (a - projections[i][d].offset[0]) / projections[i][d].slope[0]; };
        const double across =
            voxel(there, last ? tile.a0 + tiles_per_view * (tile.a1 - tile.a0) : tile.a0) - voxel(here, tile.a0);
        const TileWeights &now = rows[here * stack], &then = rows[there * stack];
        const int down = now.nonempty && then.nonempty ? then.begin - now.begin : 0;
        return (last ? -z0 : z1 - z0) * g.grid.slice() + int64_t(down) * g.grid.nx + int64_t(across);
    }

    void add_slab(size_t n, int z0, int z1, const Tile& tile, const TileWeights* of_view, Scratch& s) const {
        const size_t i = n / tiles_per_view;
        const View& v = g.views[views[i]];
        const int first = z0 * v.subslices, count = (z1 - z0) * v.subslices;
        if (int(s.columns.size()) < count) s.columns.resize(count);
        for (int d = 0; d < count; d++) {
            const int moments = max_moments_of(of_view + size_t(first + d) * stack, stack);
            s.columns[d].weights.nonempty = false;
            if (moments == 0) continue;
            forward_weights(projections[i][first + d], moments, tile.a0, tile.a1 - tile.a0, g.grid.nx,
                            s.columns[d].weights);
            if (s.columns[d].weights.nonempty) s.columns[d].prepare(g.grid.nx, avx512_allowed());
        }
        for (int t = 0; t < stack; t++) {
            const TileWeights* rows = of_view + t;
            const int64_t prefetch_distance = prefetch_distance_of(i, z0, z1, tile, rows);
            for (int d = 0; d < count; d++) {
                const TileWeights& here = rows[size_t(first + d) * stack];
                const int z = z0 + d / v.subslices;
                if (!here.nonempty || !s.columns[d].weights.nonempty) continue;
                const bool prefetches =
                    size_t(z - z0) % views.size() == i; // one view for each slice: they read nearly the same voxels
                const SourceRows source{f + z * g.grid.slice(), g.grid.nx, g.grid.nx};
                float* sum = sum_of(s, n, t);
                if (!add_subslice_avx512(source, here, s.columns[d], prefetches ? prefetch_distance : 0, sum))
                    add_subslice(source, here, s.columns[d], s.buffer, sum);
            }
        }
    }
};

} // namespace

void project_tiles(const ScanGeometry& g, const float* f, const std::vector<float*>& images, bool add) {
    std::vector<Scratch> scratch(threads());
    std::vector<int> all;
    for (size_t k = 0; k < images.size(); k++)
        if (images[k]) all.push_back(int(k));
    int subslices = 1;
    for (int k : all) subslices = std::max(subslices, g.views[k].subslices);
    const size_t most = std::max(1, std::min(max_views, max_row_weights / (g.grid.nz * subslices * max_stack)));
    const size_t groups = (all.size() + most - 1) / most;
    for (size_t n = 0; n < groups; n++) {
        const std::vector<int> views(all.begin() + all.size() * n / groups,
                                     all.begin() + all.size() * (n + 1) / groups);
        const Forward forward(g, f, images, add, views);
        const int down = forward.along.size(), across = forward.across.size();
        const int parts = std::max(1, std::min(across, tasks_per_thread * threads() / down));
        // Tasks that share a row of blocks share its rows' weights.
        std::vector<std::vector<TileWeights>> shared(parts > 1 ? down : 0);
        for (auto& rows : shared) rows.resize(forward.rows());
        parallel_tasks(int64_t(shared.size() * views.size()), [&](int64_t task, int) {
            const size_t row = task / views.size();
            forward.make_row_weights(forward.along.begin + int(row), task % views.size(), shared[row].data());
        });
        parallel_tasks(int64_t(down) * parts, [&](int64_t task, int thread) {
            const int row = int(task / parts), part = int(task % parts), first = forward.across.begin;
            Scratch& s = scratch[thread];
            if (shared.empty()) {
                s.rows.resize(std::max(s.rows.size(), forward.rows()));
                for (size_t i = 0; i < views.size(); i++)
                    forward.make_row_weights(forward.along.begin + row, i, s.rows.data());
            }
            forward.project_strip(forward.along.begin + row, first + across * part / parts,
                                  first + across * (part + 1) / parts,
                                  shared.empty() ? s.rows.data() : shared[row].data(), s);
        });
    }
}

} // namespace palpate
