#include "descent.h"
#include "parallel.h"
#include "solve.h"
#include <algorithm>
#include <atomic>
#include <thread>

namespace palpate {
namespace {

// out = image · path, or · path² for a curvature, for pixels `step` apart; length: the paths, or null for 1.
PALPATE_KERNEL void fold(const float* __restrict image, const float* __restrict length, bool curvature, int count,
                         int64_t step, float* __restrict out) {
    for (int i = 0; i < count; i++) out[i] = image[i * step];
    if (!length) return;
    for (int i = 0; i < count; i++) out[i] *= length[i] * (curvature ? length[i] : 1);
}

} // namespace

Paraboloid::Paraboloid(const Geometry& geometry, const float* slope, const float* curvature) {
    int64_t size = 0;
    for (const View& v : geometry.views)
        for (int i = 0; i < 2; i++) {
            start.push_back(size);
            const Layout layout(v);
            size += layout.rows * layout.stride + column_padding;
        }
    images = Pages(size);
    parallel(int64_t(start.size()), [&](int64_t begin, int64_t end, int) {
        for (int64_t i = begin; i < end; i++) {
            const View& v = geometry.views[i / 2];
            const Layout layout(v);
            const float* image = (i % 2 ? curvature : slope) + i / 2 * geometry.pixels();
            float* out = images.data() + start[i];
            std::vector<float> length(layout.columns);
            for (int row = 0; row < layout.rows; row++, out += layout.stride) {
                const int64_t pixel = layout.start + row * layout.down;
                if (layout.separable) v.path(pixel, layout.right, layout.columns, length.data());
                fold(image + pixel, layout.separable ? length.data() : nullptr, i % 2, layout.columns, layout.right,
                     out);
                std::fill(out + layout.columns, out + layout.stride, 0.0f);
            }
            std::fill_n(out, column_padding, 0.0f);
        }
    });
}

namespace {

// What one thread needs, made once a sweep.
struct Scratch {
    std::vector<Sums> sums; // per separable view
    std::vector<float> prior;
    Line line;
    Lists::Scratch lists;
};

// (rows) pointers to n floats each, to lanes: out[x * lanes + i] = rows[i][x]; absent rows are 0.
PALPATE_KERNEL void into_lanes(const float* const* rows, int count, int64_t n, float* out) {
    int64_t x = 0;
    for (; x + lanes <= n; x += lanes) {
        Lanes m[lanes] = {};
        PALPATE_UNROLL
        for (int i = 0; i < lanes; i++)
            if (i < count) load(m[i], rows[i] + x);
        transpose(m);
        store_each(out + x * lanes, lanes, m);
    }
    for (; x < n; x++)
        for (int i = 0; i < lanes; i++) out[x * lanes + i] = i < count ? rows[i][x] : 0;
}

PALPATE_KERNEL void out_of_lanes(const float* in, int count, int64_t n, float* const* rows) {
    int64_t x = 0;
    for (; x + lanes <= n; x += lanes) {
        Lanes m[lanes];
        load_each(m, in + x * lanes, lanes);
        transpose(m);
        PALPATE_UNROLL
        for (int i = 0; i < lanes; i++)
            if (i < count) store(rows[i] + x, m[i]);
    }
    for (; x < n; x++)
        for (int i = 0; i < count; i++) rows[i][x] = in[x * lanes + i];
}

// Footprints of a slice in all views.
struct Slice {
    const Geometry& geometry;
    std::vector<int> separable; // views
    std::vector<SliceView> views;
    Lists lists;
    int z = 0, stride = 1;

    explicit Slice(const Geometry& g) : geometry(g), lists(g) {
        for (size_t k = 0; k < g.views.size(); k++)
            if (Layout(g.views[k]).separable) separable.push_back(int(k));
        views.resize(separable.size());
    }

    void make(int slice) {
        z = slice;
        std::vector<int> apart(views.size() + lists.size());
        lists.make(z);
        parallel(int64_t(apart.size()), [&](int64_t begin, int64_t end, int) {
            for (int64_t k = begin; k < end; k++)
                if (k < int64_t(views.size())) {
                    views[k].make(geometry, geometry.views[separable[k]], z);
                    apart[k] = views[k].rows_apart();
                } else {
                    apart[k] = lists.rows_apart(k - views.size());
                }
        });
        stride = std::max(2, *std::max_element(apart.begin(), apart.end())); // the prior binds neighbouring rows
    }

    // Cells of voxels begin .. end - 1.
    void gather(const Strip& strip, int begin, int end, Paraboloid& data, Scratch& s) const {
        s.sums.resize(views.size());
        s.line.views.resize(views.size());
        for (size_t k = 0; k < views.size(); k++) {
            const AxisTerms& x = views[k].x();
            views[k].gather(strip, data.slope(separable[k]), data.curvature(separable[k]), begin, end, s.sums[k]);
            s.line.views[k] = {x.weight.data(), x.first.data(), s.sums[k].cells.data(),
                               s.sums[k].begin, x.terms,        x.width};
        }
    }

    void spread(const Strip& strip, Paraboloid& data, Scratch& s) const {
        for (size_t k = 0; k < views.size(); k++)
            views[k].spread(strip, data.curvature(separable[k]), s.sums[k], data.slope(separable[k]));
    }
};

// Voxels begin .. end - 1 of a strip.
void descend_strip(const Slice& slice, const Solve& solve, const Strip& strip, int begin, int end, bool backwards,
                   Paraboloid& data, Scratch& s, float* f) {
    const Neighbourhood& n = solve.neighbours;
    const int count = end - begin;
    Line& line = s.line;
    float* rows[lanes];
    for (int i = 0; i < strip.rows; i++) rows[i] = f + (int64_t(slice.z) * n.ny + strip.y[i]) * n.nx + begin;
    line.begin = begin;
    line.f.resize((count + 2) * lanes);
    into_lanes(rows, strip.rows, count, line.f.data() + lanes);
    for (int i = 0; i < lanes; i++) {
        line.f[i] = i < strip.rows && begin > 0 ? rows[i][-1] : 0;
        line.f[(count + 1) * lanes + i] = i < strip.rows && end < n.nx ? rows[i][count] : 0;
    }
    if (solve.beta > 0) {
        s.prior.resize(2 * lanes * n.nx);
        float *gradient[lanes], *curvature[lanes];
        for (int i = 0; i < strip.rows; i++) {
            gradient[i] = s.prior.data() + 2 * i * count;
            curvature[i] = gradient[i] + count;
            prior_across_rows(n, f, slice.z, strip.y[i], begin, end, gradient[i], curvature[i]);
        }
        line.gradient.resize(count * lanes);
        line.curvature.resize(count * lanes);
        into_lanes(gradient, strip.rows, count, line.gradient.data());
        into_lanes(curvature, strip.rows, count, line.curvature.data());
    }
    slice.gather(strip, begin, end, data, s);
    solve.along(line, count, backwards, strip, data, s.lists);
    slice.spread(strip, data, s);
    out_of_lanes(line.f.data() + lanes, strip.rows, count, rows);
}

// Rows y, y + stride, ... of one block.
Strip strip_of(int y, int stride, int ny) {
    Strip strip;
    for (; y < ny && strip.rows < lanes; y += stride) strip.y[strip.rows++] = y;
    return strip;
}

void descend_block(const Slice& slice, const Solve& solve, int block, bool backwards, Paraboloid& data, Scratch& s,
                   float* f) {
    const Neighbourhood& n = solve.neighbours;
    const int nx = int(n.nx), parts = (nx + voxels_at_once - 1) / voxels_at_once;
    for (int i = 0; i < parts; i++) {
        const int begin = (backwards ? parts - 1 - i : i) * voxels_at_once, end = std::min(nx, begin + voxels_at_once);
        for (int j = 0; j < slice.stride; j++) {
            const int first = block * lanes * slice.stride + (backwards ? slice.stride - 1 - j : j);
            const Strip strip = strip_of(first, slice.stride, int(n.ny));
            if (strip.rows) descend_strip(slice, solve, strip, begin, end, backwards, data, s, f);
        }
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

void descend(const Geometry& geometry, const Neighbourhood& n, const Sweep& sweep, Paraboloid& data, float* f) {
    Slice slice(geometry);
    const Solve solve{n, sweep.beta, sweep.relaxation, slice.lists};
    std::vector<Scratch> scratch(threads());
    for (int64_t i = 0; i < n.nz; i++) {
        slice.make(int(sweep.backwards ? n.nz - 1 - i : i));
        Turns turns(int((n.ny + lanes * slice.stride - 1) / (lanes * slice.stride)), sweep.backwards);
        parallel(int64_t(scratch.size()), [&](int64_t, int64_t, int thread) {
            for (int block; (block = turns.take()) >= 0; turns.finish(block))
                descend_block(slice, solve, block, sweep.backwards, data, scratch[thread], f);
        });
    }
}

// d: the slice's, (ny, nx). Nothing is spread, so the rows may share pixels.
static void strip_diagonal(const Slice& slice, const Strip& strip, Paraboloid& data, Scratch& s, float* d) {
    const int nx = slice.geometry.grid.nx;
    for (int begin = 0; begin < nx; begin += voxels_at_once) {
        const int end = std::min(nx, begin + voxels_at_once);
        slice.gather(strip, begin, end, data, s);
        s.line.begin = begin;
        s.line.f.resize(voxels_at_once * lanes);
        line_curvature(s.line, end - begin, s.line.f.data());
        for (int x = begin; x < end && !slice.lists.empty(); x++) {
            Lanes slope = {}, sum;
            load(sum, &s.line.f[(x - begin) * lanes]);
            slice.lists.measure(strip, x, data, s.lists, slope, sum);
            store(&s.line.f[(x - begin) * lanes], sum);
        }
        float* rows[lanes];
        for (int i = 0; i < strip.rows; i++) rows[i] = d + int64_t(strip.y[i]) * nx + begin;
        out_of_lanes(s.line.f.data(), strip.rows, end - begin, rows);
    }
}

void diagonal(const Geometry& geometry, Paraboloid& data, int every, float* d) {
    const Grid& grid = geometry.grid;
    Slice slice(geometry);
    std::vector<Scratch> scratch(threads());
    for (int z = every / 2; z < grid.nz; z += every) {
        slice.make(z);
        parallel((grid.ny + lanes - 1) / lanes, [&](int64_t begin, int64_t end, int thread) {
            for (int64_t k = begin; k < end; k++)
                strip_diagonal(slice, strip_of(int(k) * lanes, 1, grid.ny), data, scratch[thread],
                               d + z / every * grid.slice());
        });
    }
}

int row_stride(const Geometry& geometry, int z) {
    Slice slice(geometry);
    slice.make(z);
    return slice.stride;
}

} // namespace palpate
