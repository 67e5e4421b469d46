#include "descent.h"
#include "across.h"
#include "interleave.h"
#include "order.h"
#include "parallel.h"
#include "solve.h"
#include <algorithm>
#include <atomic>
#include <thread>

namespace palpate {
namespace {

// What one thread needs, made once a sweep.
struct Scratch {
    std::vector<Columns> columns; // per separable view
    Buffer rows, row;             // sums of the columns; of each row: what the prior says, then its changes
    Planes planes;
    Line line;
    Lists::Scratch lists;
};

// Footprints of a slice in all views.
struct Slice {
    const Geometry& geometry;
    std::vector<int> separable; // views
    std::vector<SliceView> views;
    Lists lists;
    int z = 0;

    explicit Slice(const Geometry& g) : geometry(g), lists(g) {
        for (size_t k = 0; k < g.views.size(); k++)
            if (Layout(g.views[k]).separable) separable.push_back(int(k));
        views.resize(separable.size());
    }

    // Making a slice, in parts that may run at once.
    int parts() const { return int(views.size()) + 1; }
    void make(int slice, int part) {
        if (part < int(views.size()))
            views[part].make(geometry, geometry.views[separable[part]], slice);
        else
            z = slice, lists.make(slice);
    }

    // What the columns say of voxels begin .. end - 1.
    void gather(const Strip& strip, int begin, int end, Paraboloid& data, Scratch& s) const {
        s.columns.resize(views.size());
        s.planes.count = 2; // slope and curvature, also where there is no view
        s.line.reach = s.line.margin = 0;
        for (size_t k = 0; k < views.size(); k++) {
            const Bands& bands = views[k].bands(s.columns[k].moments = views[k].moments_of(strip));
            if (bands.walked()) continue;
            s.planes.count = std::max(s.planes.count, bands.planes());
            s.line.reach = std::max(s.line.reach, bands.reach());
            s.line.margin = std::max(s.line.margin, bands.margin());
        }
        s.planes.values.resize(s.planes.count * lanes * Planes::pitch);
        std::fill_n(s.planes.values.data(), s.planes.values.size(), 0.0f);
        for (size_t k = 0; k < views.size(); k++)
            views[k].gather(strip, data.slope(separable[k]), data.curvature(separable[k]), begin, end, s.columns[k],
                            s.rows, s.planes);
        s.line.walks.clear();
        for (Columns& columns : s.columns)
            if (columns.walk.bands) s.line.walks.push_back(&columns.walk);
    }

    void spread(const Strip& strip, int begin, int end, const float* const* change, Paraboloid& data,
                Scratch& s) const {
        for (size_t k = 0; k < views.size(); k++)
            views[k].spread(strip, change, data.curvature(separable[k]), begin, end, s.columns[k], s.rows,
                            data.slope(separable[k]));
    }
};

// Voxels begin .. end - 1 of a strip, one lane a row, as the solve along x wants them.
void lay_out(const Slice& slice, const Solve& solve, const Strip& strip, int begin, int end, bool backwards,
             float* const* rows, Scratch& s, const float* f) {
    const Neighbourhood& n = solve.neighbours;
    const int count = end - begin;
    Line& line = s.line;
    const float* from[lanes];
    line.begin = begin;
    line.f.resize((count + 2) * lanes);
    into_lanes(rows, strip.rows, count, line.f.data() + lanes);
    for (int i = 0; i < lanes; i++) {
        line.f[i] = i < strip.rows && begin > 0 ? rows[i][-1] : 0;
        line.f[(count + 1) * lanes + i] = i < strip.rows && end < n.nx ? rows[i][count] : 0;
    }
    line.slope.resize(count * lanes);
    line.coupling.resize(line.reach + 1);
    line.change.resize((line.reach + count + line.reach) * lanes);
    std::fill_n(line.change.begin(), line.reach * lanes, 0.0f);
    std::fill_n(line.change.end() - line.reach * lanes, line.reach * lanes, 0.0f);
    for (int k = -1; k <= line.reach; k++) {
        for (int i = 0; i < strip.rows; i++) from[i] = s.planes.of(1 + k, i);
        if (k >= 0) line.coupling[k].resize((line.reach + count) * lanes);
        into_lanes(from, strip.rows, count, k < 0 ? line.slope.data() : &line.coupling[k][line.reach * lanes]);
    }
    if (!(solve.beta > 0)) return;
    s.row.resize(std::max(s.row.size(), size_t(2 * lanes * Planes::pitch)));
    for (int i = 0; i < strip.rows; i++)
        prior_of_row(n, f, slice.z, strip.y[i], begin, end, backwards, &s.row[2 * i * Planes::pitch],
                     &s.row[(2 * i + 1) * Planes::pitch]);
    line.prior_slope.resize(count * lanes);
    line.prior_curvature.resize(count * lanes);
    for (int k = 0; k < 2; k++) {
        for (int i = 0; i < strip.rows; i++) from[i] = &s.row[(2 * i + k) * Planes::pitch];
        into_lanes(from, strip.rows, count, k ? line.prior_curvature.data() : line.prior_slope.data());
    }
}

// The changes back to rows, and from there to the images.
void spread_changes(const Slice& slice, const Strip& strip, int begin, int end, Paraboloid& data, Scratch& s) {
    const int count = end - begin, margin = s.line.margin;
    const int pitch = (margin + count + margin + lanes - 1) / lanes * lanes;
    s.row.resize(std::max(s.row.size(), size_t(lanes * pitch)));
    float* change[lanes];
    for (int i = 0; i < lanes; i++) {
        change[i] = &s.row[i * pitch + margin];
        std::fill_n(change[i] - margin, margin, 0.0f);
        std::fill_n(change[i] + count, pitch - margin - count, 0.0f);
    }
    out_of_lanes(&s.line.change[s.line.reach * lanes], strip.rows, count, change);
    slice.spread(strip, begin, end, change, data, s);
}

void descend_strip(const Slice& slice, const Solve& solve, const Strip& strip, int begin, int end, bool backwards,
                   Paraboloid& data, Scratch& s, float* f) {
    const Neighbourhood& n = solve.neighbours;
    float* rows[lanes];
    for (int i = 0; i < strip.rows; i++) rows[i] = f + (int64_t(slice.z) * n.ny + strip.y[i]) * n.nx + begin;
    slice.gather(strip, begin, end, data, s);
    lay_out(slice, solve, strip, begin, end, backwards, rows, s, f);
    solve.along(s.line, end - begin, backwards, strip, data, s.lists);
    out_of_lanes(s.line.f.data() + lanes, strip.rows, end - begin, rows);
    spread_changes(slice, strip, begin, end, data, s);
}

// Rows y, y + stride, ... of one block.
Strip strip_of(int y, int stride, int ny) {
    Strip strip;
    for (; y < ny && strip.rows < lanes; y += stride) strip.y[strip.rows++] = y;
    return strip;
}

// The footprints of a slab's slices; those of the next are made while the last blocks of this one are worked on.
struct Footing {
    Slab slab;
    std::vector<Slice> slices;
    std::atomic<int> next{0}; // part

    Footing(const Geometry& g, int depth) : slices(depth, Slice(g)) {}
    void start(const Slab& chosen) {
        slab = chosen;
        next = 0;
    }
    void make() {
        const int parts = slices[0].parts(), count = (slab.end - slab.begin) * parts;
        for (int i; (i = next++) < count;) slices[i / parts].make(slab.begin + i / parts, i % parts);
    }
};

// One block of rows in all slices of a slab, part by part.
void descend_block(const Footing& footing, const Neighbourhood& n, const Sweep& sweep, int block, Paraboloid& data,
                   Scratch& s, float* f) {
    const Slab& slab = footing.slab;
    const int nx = int(n.nx), parts = (nx + voxels_at_once - 1) / voxels_at_once, depth = slab.end - slab.begin;
    for (int i = 0; i < parts * depth * slab.stride; i++) {
        const int at = sweep.backwards ? parts * depth * slab.stride - 1 - i : i;
        const int begin = at / (depth * slab.stride) * voxels_at_once, end = std::min(nx, begin + voxels_at_once);
        const Slice& slice = footing.slices[at / slab.stride % depth];
        const Strip strip = strip_of(block * lanes * slab.stride + at % slab.stride, slab.stride, int(n.ny));
        const Solve solve{n, sweep.beta, sweep.relaxation, slice.lists};
        if (strip.rows) descend_strip(slice, solve, strip, begin, end, sweep.backwards, data, s, f);
    }
}

// All blocks of one parity, then those of the other as soon as their neighbours are done: threads take them in that
// order, so that the block that all others wait for is always being worked on.
class Turns {
    std::vector<std::atomic<bool>> done;
    std::atomic<int> next{0};
    const int blocks, first;

public:
    Turns(int blocks, bool backwards) : done(blocks), blocks(blocks), first(backwards && blocks > 1 ? 1 : 0) {
        for (auto& d : done) d = false;
    }
    // The next block, or -1.
    int take() {
        const int i = next++, leading = first ? blocks / 2 : (blocks + 1) / 2;
        if (i >= blocks) return -1;
        if (i < leading) return 2 * i + first;
        const int block = 2 * (i - leading) + 1 - first;
        for (int beside : {block - 1, block + 1})
            while (beside >= 0 && beside < blocks && !done[beside].load(std::memory_order_acquire))
                std::this_thread::yield();
        return block;
    }
    void finish(int block) { done[block].store(true, std::memory_order_release); }
};

} // namespace

void descend(const Neighbourhood& n, const Sweep& sweep, Paraboloid& data, float* f) {
    const Geometry& geometry = data.geometry;
    std::vector<Slab> order = slabs(geometry);
    if (sweep.backwards) std::reverse(order.begin(), order.end());
    int depth = 0;
    for (const Slab& slab : order) depth = std::max(depth, slab.end - slab.begin);
    Footing one(geometry, depth), two(geometry, depth), *now = &one, *next = &two;
    std::vector<Scratch> scratch(threads());
    now->start(order[0]);
    parallel(threads(), [&](int64_t, int64_t, int) { now->make(); });
    for (size_t i = 0; i < order.size(); i++) {
        const bool last = i + 1 == order.size();
        if (!last) next->start(order[i + 1]);
        const int rows = lanes * order[i].stride;
        Turns turns(int((n.ny + rows - 1) / rows), sweep.backwards);
        parallel(threads(), [&](int64_t, int64_t, int thread) {
            for (int block; (block = turns.take()) >= 0; turns.finish(block))
                descend_block(*now, n, sweep, block, data, scratch[thread], f);
            if (!last) next->make();
        });
        std::swap(now, next);
    }
}

// d: (the strip's rows, nx). Nothing is spread, so the rows may share pixels.
static void strip_diagonal(const Slice& slice, const Strip& strip, Paraboloid& data, Scratch& s, float* d) {
    const int nx = slice.geometry.grid.nx;
    for (int begin = 0; begin < nx; begin += voxels_at_once) {
        const int end = std::min(nx, begin + voxels_at_once);
        slice.gather(strip, begin, end, data, s);
        for (int i = 0; i < strip.rows; i++) std::copy_n(s.planes.of(1, i), end - begin, d + int64_t(i) * nx + begin);
        for (int x = begin; x < end && !(s.line.walks.empty() && slice.lists.empty()); x++) {
            Lanes slope = {}, sum = {};
            measure(s.line.walks, x, slope, sum);
            slice.lists.measure(strip, x, data, s.lists, slope, sum);
            for (int i = 0; i < strip.rows; i++) d[int64_t(i) * nx + x] += sum[i];
        }
    }
}

void diagonal(Paraboloid& data, int every, int every_row, float* d) {
    const Grid& grid = data.geometry.grid;
    const int rows = sampled(grid.ny, every_row);
    Slice slice(data.geometry);
    std::vector<Scratch> scratch(threads());
    for (int z = every / 2; z < grid.nz; z += every, d += int64_t(rows) * grid.nx) {
        parallel_tasks(slice.parts(), [&](int64_t part, int) { slice.make(z, int(part)); });
        parallel((rows + lanes - 1) / lanes, [&](int64_t begin, int64_t end, int thread) {
            for (int64_t k = begin; k < end; k++) {
                const Strip strip = strip_of(int(k) * lanes * every_row + every_row / 2, every_row, grid.ny);
                strip_diagonal(slice, strip, data, scratch[thread], d + k * lanes * grid.nx);
            }
        });
    }
}

} // namespace palpate
