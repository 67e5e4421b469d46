// Forward projection of the separable views, in tiles that stay in the second-level cache while all slices add to them.
// The volume's middle slice is cut into blocks, and every panel where their shadows end: the tiles of a few views under
// one block read nearly the same voxels of a slice, which come from memory once for all of them.
#include "forward.h"
#include "buffer.h"
#include "lengths.h"
#include "parallel.h"
#include "passes.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int abreast = 2;    // tiles of a view side by side: less of each page of the volume is passed over
constexpr int together = 5;   // views whose tiles, and all they read of a slab, the cache holds together, at most
constexpr int tall = 4;       // tiles of a panel, one above the other, that share their weights along x, at most
constexpr int layers = 8;     // slices of a slab, times tiles one above the other
constexpr int kept = 4096;    // rows' weights of so many sub-slices and tiles, at most: some 10 MB
constexpr int tasks_each = 4; // per thread, so that none waits long for another
constexpr int soon = 8;       // rows of a panel to call for in advance

// Blocks along one axis: number i reaches from voxel edge i * step to the next; its shadow has at most `size` pixels.
class Blocks {
    double step = HUGE_VAL;
    std::vector<Shadow> middle; // per view, of the slice in the middle

public:
    int begin = INT32_MAX, end = INT32_MIN;

    Blocks(const Geometry& g, const std::vector<int>& views, Axis axis, int size) {
        for (int k : views) {
            middle.push_back(shadow(g, g.views[k], g.grid.nz / 2, 0, axis));
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
    // First pixel of block `number`, of view number i of these.
    int edge(size_t i, int number, int pixels) const {
        const double at = std::round(middle[i].offset[0] + middle[i].slope[0] * step * number);
        return number == begin ? 0 : number == end ? pixels : int(std::min(std::max(at, 0.0), double(pixels)));
    }
};

// Writes a tile of a view's image to the measured pixels, scaled by the rays' lengths, or as it is to the fine ones of
// a tilted panel.
void write_tile(const View& v, const Lengths& lengths, const float* from, int b0, int b1, int a0, int columns,
                float* image) {
    for (int b = b0; b < b1; b++, from += width) {
        if (v.pose == Pose::tilted) {
            std::copy_n(from, columns, image + int64_t(b) * v.na + a0);
            continue;
        }
        float scaled[width];
        float* first = image + v.start + b * v.step_b + a0 * v.step_a;
        for (int a = 0; a < columns + cache_line - 1 && v.step_a == 1; a += cache_line)
            __builtin_prefetch(first + soon * v.step_b + a, 1, 3);
        lengths.scale(b, from, v.step_a == 1 ? first : scaled);
        for (int a = 0; a < columns && v.step_a != 1; a++) first[a * v.step_a] = scaled[a];
    }
}

struct Tile {
    int b0, b1, a0, a1;
    bool empty() const { return b0 >= b1 || a0 >= a1; }
};

// What a thread needs, kept between its tasks.
struct Scratch {
    std::vector<Spans> rows;          // of a strip
    std::vector<ColumnSpans> columns; // per sub-slice of a slab
    RowRing ring;
    Buffer sum;
    Lengths lengths;
};

// How many tiles of a view stand one above the other. Weights along x are shared by them, which counts where a tile
// asks for one product a slice; the slab that they read is as much larger.
int stack_of(const Geometry& g, const std::vector<int>& views) {
    const bool light = std::all_of(views.begin(), views.end(), [&](int k) { return products(g.views[k]) == 1; });
    return light ? tall : tall / 2;
}

class Forward {
    const Geometry& g;
    const float* f;
    const std::vector<float*>& images;
    std::vector<int> views;                   // of one group
    std::vector<std::vector<Shadow>> shadows; // along x; per view, per sub-slice
    std::vector<size_t> rows_of{0};           // where each view's begin among the rows of a strip
    const int stack, slab;                    // tiles one above the other; slices

    int depth(size_t i) const { return g.grid.nz * g.views[views[i]].subs; }
    float* sum_of(Scratch& s, size_t number, int t) const { return &s.sum[(number * stack + t) * height * width]; }

public:
    const Blocks across, along;

    Forward(const Geometry& g, const float* f, const std::vector<float*>& images, const std::vector<int>& views)
        : g(g), f(f), images(images), views(views), stack(stack_of(g, views)), slab(layers / stack),
          across(g, views, Axis::x, width), along(g, views, Axis::y, stack * height) {
        for (int k : views) {
            const View& v = g.views[k];
            rows_of.push_back(rows_of.back() + size_t(g.grid.nz) * v.subs * stack);
            shadows.emplace_back();
            for (int i = 0; i < g.grid.nz * v.subs; i++)
                shadows.back().push_back(shadow(g, v, i / v.subs, i % v.subs, Axis::x));
        }
    }

    // The weights that strip() takes, of the rows of row `down` of blocks: how many there are, and those of view number
    // i. Per view, slice, sub-slice, tile of the stack.
    size_t rows() const { return rows_of.back(); }
    void cast_rows(int down, size_t i, Spans* rows) const {
        const View& v = g.views[views[i]];
        const int b0 = along.edge(i, down, v.nb), b1 = along.edge(i, down + 1, v.nb);
        Spans* out = rows + rows_of[i];
        for (int d = 0; d < depth(i); d++) {
            const Shadow y = shadow(g, v, d / v.subs, d % v.subs, Axis::y);
            for (int t = 0; t < stack; t++, out++) {
                const int b = b0 + t * height, count = std::min(height, b1 - b);
                out->reached = false;
                if (count <= 0) continue;
                over_pixels(y, v.moments, b, count, g.grid.ny, *out);
                calm_pixels(v, *out);
            }
        }
    }

    // The tiles under blocks number `first` to `last` - 1 across of row `down` of blocks.
    void strip(int down, int first, int last, const Spans* rows, Scratch& s) const {
        s.sum.resize(views.size() * abreast * stack * height * width);
        std::vector<Tile> tiles(views.size() * abreast);
        for (int block = first; block < last; block += abreast) {
            for (size_t n = 0; n < tiles.size(); n++) {
                const size_t i = n / abreast;
                const View& v = g.views[views[i]];
                const int beside = std::min(block + int(n % abreast), last);
                tiles[n] = {along.edge(i, down, v.nb), along.edge(i, down + 1, v.nb), across.edge(i, beside, v.na),
                            across.edge(i, std::min(beside + 1, last), v.na)};
            }
            if (std::all_of(tiles.begin(), tiles.end(), [](const Tile& t) { return t.empty(); })) continue;
            std::fill(s.sum.begin(), s.sum.end(), 0.0f);
            // Slab by slab, which stays in the second-level cache for all views while they call for the next one.
            for (int z = 0; z < g.grid.nz; z += slab)
                for (size_t n = 0; n < tiles.size(); n++)
                    if (!tiles[n].empty())
                        add_slab(n, z, std::min(g.grid.nz, z + slab), tiles[n], rows + rows_of[n / abreast], s);
            for (size_t n = 0; n < tiles.size(); n++) write_tiles(n, tiles[n], s);
        }
    }

private:
    void write_tiles(size_t n, const Tile& tile, Scratch& s) const {
        if (tile.empty()) return;
        const int k = views[n / abreast], columns = tile.a1 - tile.a0;
        s.lengths.make(g.views[k], tile.a0, columns, tile.b0, tile.b1);
        for (int t = 0, b = tile.b0; b < tile.b1; t++, b += height)
            write_tile(g.views[k], s.lengths, sum_of(s, n, t), b, std::min(tile.b1, b + height), tile.a0, columns,
                       images[k]);
    }

    // From what a tile reads of slices z0 to z1 - 1 to what it reads next, of the slab behind them or of the next
    // block's first one: floats, roughly.
    int64_t way_on(size_t i, int z0, int z1, const Tile& tile, const Spans* rows) const {
        const bool last = z1 == g.grid.nz;
        const int subs = g.views[views[i]].subs, here = z0 * subs, there = last ? 0 : z1 * subs;
        const auto voxel = [&](int d, int a) { return (a - shadows[i][d].offset[0]) / shadows[i][d].slope[0]; };
        const double across =
            voxel(there, last ? tile.a0 + abreast * (tile.a1 - tile.a0) : tile.a0) - voxel(here, tile.a0);
        const Spans &now = rows[here * stack], &then = rows[there * stack];
        const int down = now.reached && then.reached ? then.begin - now.begin : 0;
        return (last ? -z0 : z1 - z0) * g.grid.slice() + int64_t(down) * g.grid.nx + int64_t(across);
    }

    void add_slab(size_t n, int z0, int z1, const Tile& tile, const Spans* of_view, Scratch& s) const {
        const size_t i = n / abreast;
        const View& v = g.views[views[i]];
        const int first = z0 * v.subs, count = (z1 - z0) * v.subs;
        if (int(s.columns.size()) < count) s.columns.resize(count);
        for (int d = 0; d < count; d++) {
            const int moments = most_moments_of(of_view + size_t(first + d) * stack, stack);
            s.columns[d].spans.reached = false;
            if (moments == 0) continue;
            over_pixels(shadows[i][first + d], moments, tile.a0, tile.a1 - tile.a0, g.grid.nx, s.columns[d].spans);
            if (s.columns[d].spans.reached) s.columns[d].prepare(g.grid.nx);
        }
        for (int t = 0; t < stack; t++) {
            const Spans* rows = of_view + t;
            const int64_t ahead = way_on(i, z0, z1, tile, rows);
            for (int d = 0; d < count; d++) {
                const Spans& here = rows[size_t(first + d) * stack];
                const int z = z0 + d / v.subs;
                if (!here.reached || !s.columns[d].spans.reached) continue;
                const bool calls =
                    size_t(z - z0) % views.size() == i; // each view for its part: they read nearly the same
                add_slice({f + z * g.grid.slice(), g.grid.nx, g.grid.nx}, here, s.columns[d], s.ring, calls ? ahead : 0,
                          sum_of(s, n, t));
            }
        }
    }
};

} // namespace

void project_tiles(const Geometry& g, const float* f, const std::vector<float*>& images) {
    std::vector<Scratch> scratch(threads());
    std::vector<int> all;
    for (size_t k = 0; k < images.size(); k++)
        if (images[k]) all.push_back(int(k));
    int subs = 1;
    for (int k : all) subs = std::max(subs, g.views[k].subs);
    const size_t most = std::max(1, std::min(together, kept / (g.grid.nz * subs * tall)));
    const size_t groups = (all.size() + most - 1) / most;
    for (size_t n = 0; n < groups; n++) {
        const std::vector<int> views(all.begin() + all.size() * n / groups,
                                     all.begin() + all.size() * (n + 1) / groups);
        const Forward forward(g, f, images, views);
        const int down = forward.along.size(), across = forward.across.size();
        const int parts = std::max(1, std::min(across, tasks_each * threads() / down));
        // Tasks that share a row of blocks share its rows' weights.
        std::vector<std::vector<Spans>> shared(parts > 1 ? down : 0);
        for (auto& rows : shared) rows.resize(forward.rows());
        parallel_tasks(int64_t(shared.size() * views.size()), [&](int64_t task, int) {
            const size_t row = task / views.size();
            forward.cast_rows(forward.along.begin + int(row), task % views.size(), shared[row].data());
        });
        parallel_tasks(int64_t(down) * parts, [&](int64_t task, int thread) {
            const int row = int(task / parts), part = int(task % parts), first = forward.across.begin;
            Scratch& s = scratch[thread];
            if (shared.empty()) {
                s.rows.resize(std::max(s.rows.size(), forward.rows()));
                for (size_t i = 0; i < views.size(); i++)
                    forward.cast_rows(forward.along.begin + row, i, s.rows.data());
            }
            forward.strip(forward.along.begin + row, first + across * part / parts, first + across * (part + 1) / parts,
                          shared.empty() ? s.rows.data() : shared[row].data(), s);
        });
    }
}

} // namespace palpate
