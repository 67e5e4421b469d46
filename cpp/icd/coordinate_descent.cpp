#include "icd/coordinate_descent.h"
#include "base/simd_transpose.h"
#include "base/thread_pool.h"
#include "icd/row_update.h"
#include "icd/slice_view.h"
#include "icd/sweep_schedule.h"
#include "icd/view_layout.h"
#include "statistics/mrf_prior_row.h"
#include <algorithm>
#include <atomic>
#include <thread>

namespace palpate {
namespace {

// What one thread needs, made once a sweep.
struct Scratch {
    std::vector<SliceViewScratch> views; // per separable view
    AlignedBuffer prior;                 // slope and curvature of each row
    GroupPart part;
};

// Footprints of a slice in all views.
struct SliceFootprints {
    const ScanGeometry& geometry;
    std::vector<int> separable; // views
    std::vector<SliceView> views;
    SparseFootprints others;
    int z = 0;

    explicit SliceFootprints(const ScanGeometry& g) : geometry(g), others(g) {
        for (size_t k = 0; k < g.views.size(); k++)
            if (ViewLayout(g.views[k]).separable) separable.push_back(int(k));
        views.resize(separable.size());
    }

    // A slice is made in tasks that may run at once.
    int tasks() const { return int(views.size()) + 1; }
    void make(int slice, int task) {
        if (task < int(views.size()))
            views[task].make(geometry, geometry.views[separable[task]], slice);
        else
            z = slice, others.make(slice);
    }

    // The sums of the images under voxels begin .. end - 1, and what the changes of these voxels do to the images.
    void gather(const RowGroup& group, int begin, int end, SurrogateImages& data, Scratch& s) const {
        s.views.resize(views.size());
        s.part.columns.resize(views.size());
        for (size_t k = 0; k < views.size(); k++)
            views[k].gather(group, data.slope(separable[k]), data.curvature(separable[k]), begin, end,
                            s.part.columns[k], s.views[k]);
    }
    void spread(const RowGroup& group, SurrogateImages& data, Scratch& s) const {
        for (size_t k = 0; k < views.size(); k++)
            views[k].spread(group, s.part.columns[k], data.curvature(separable[k]), s.views[k],
                            data.slope(separable[k]));
    }
};

// Slope and curvature of the prior for voxels begin .. end - 1 of a row group, one lane a row.
void gather_prior(const Neighbourhood& n, int z, const RowGroup& group, int begin, int end, bool backwards,
                  const float* f, Scratch& s) {
    constexpr int pitch = voxels_at_once + 2 * lanes; // no power of two: rows would share their places in the cache
    const int count = end - begin;
    const float* rows[lanes];
    s.prior.resize(2 * lanes * pitch);
    for (int i = 0; i < group.rows; i++)
        prior_of_row(n, f, z, group.y[i], begin, end, backwards, &s.prior[2 * i * pitch],
                     &s.prior[(2 * i + 1) * pitch]);
    s.part.prior_slope.resize(count * lanes);
    s.part.prior_curvature.resize(count * lanes);
    for (int k = 0; k < 2; k++) {
        for (int i = 0; i < group.rows; i++) rows[i] = &s.prior[(2 * i + k) * pitch];
        into_lanes(rows, group.rows, count, k ? s.part.prior_curvature.data() : s.part.prior_slope.data());
    }
}

// Where f is held at 0 in voxels begin .. end - 1 of a row group. False if that is everywhere.
bool gather_support(const Neighbourhood& n, int z, const RowGroup& group, int begin, int end, const uint8_t* support,
                    AlignedBuffer& inside) {
    bool any = false;
    inside.assign((end - begin) * lanes, 0.0f);
    for (int i = 0; i < group.rows; i++) {
        const uint8_t* row = support + (int64_t(z) * n.ny + group.y[i]) * n.nx + begin;
        for (int x = 0; x < end - begin; x++)
            if (row[x]) inside[x * lanes + i] = 1, any = true;
    }
    return any;
}

// Voxels begin .. end - 1 of a row group.
void descend_part(const SliceFootprints& slice, const RowUpdate& row_update, const RowGroup& group, int begin, int end,
                  bool backwards, const uint8_t* support, SurrogateImages& data, Scratch& s, float* f) {
    const Neighbourhood& n = row_update.neighbours;
    if (support && !gather_support(n, slice.z, group, begin, end, support, s.part.inside)) return;
    const int count = end - begin;
    float* rows[lanes];
    for (int i = 0; i < group.rows; i++) rows[i] = f + (int64_t(slice.z) * n.ny + group.y[i]) * n.nx + begin;
    GroupPart& part = s.part;
    part.begin = begin;
    part.f.resize((count + 2) * lanes);
    into_lanes(rows, group.rows, count, part.f.data() + lanes);
    for (int i = 0; i < lanes; i++) {
        part.f[i] = i < group.rows && begin > 0 ? rows[i][-1] : 0;
        part.f[(count + 1) * lanes + i] = i < group.rows && end < n.nx ? rows[i][count] : 0;
    }
    slice.gather(group, begin, end, data, s);
    if (row_update.beta > 0) gather_prior(n, slice.z, group, begin, end, backwards, f, s);
    row_update.update(part, count, backwards, group, data);
    out_of_lanes(part.f.data() + lanes, group.rows, count, rows);
    slice.spread(group, data, s);
}

// Rows y, y + stride, ... of one block.
RowGroup row_group(int y, int stride, int ny) {
    RowGroup group;
    for (; y < ny && group.rows < lanes; y += stride) group.y[group.rows++] = y;
    return group;
}

// The footprints of a slab's slices; those of the next are made while the last blocks of this one are worked on.
struct SlabFootprints {
    Slab slab;
    std::vector<SliceFootprints> slices;
    std::atomic<int> next{0}; // task

    SlabFootprints(const ScanGeometry& g, int depth) : slices(depth, SliceFootprints(g)) {}
    void start(const Slab& chosen) {
        slab = chosen;
        next = 0;
    }
    void make() {
        const int tasks = slices[0].tasks(), count = (slab.end - slab.begin) * tasks;
        for (int i; (i = next++) < count;) slices[i / tasks].make(slab.begin + i / tasks, i % tasks);
    }
};

// One block of rows in all slices of a slab, part by part.
void descend_block(const SlabFootprints& footprints, const Neighbourhood& n, const Sweep& sweep, int block,
                   const uint8_t* support, SurrogateImages& data, Scratch& s, float* f) {
    const Slab& slab = footprints.slab;
    const int nx = int(n.nx), parts = (nx + voxels_at_once - 1) / voxels_at_once, depth = slab.end - slab.begin;
    for (int i = 0; i < parts * depth * slab.stride; i++) {
        const int at = sweep.backwards ? parts * depth * slab.stride - 1 - i : i;
        const int begin = at / (depth * slab.stride) * voxels_at_once, end = std::min(nx, begin + voxels_at_once);
        const SliceFootprints& slice = footprints.slices[at / slab.stride % depth];
        const RowGroup group = row_group(block * lanes * slab.stride + at % slab.stride, slab.stride, int(n.ny));
        const RowUpdate row_update{n, sweep.beta, sweep.relaxation, slice.others, support != nullptr};
        if (group.rows) descend_part(slice, row_update, group, begin, end, sweep.backwards, support, data, s, f);
    }
}

// All blocks of one parity, then those of the other as soon as their neighbours are done: threads take them in that
// order, so that the block that all others wait for is always being worked on.
class BlockQueue {
    std::vector<std::atomic<bool>> done;
    std::atomic<int> next{0};
    const int blocks, first;

public:
    BlockQueue(int blocks, bool backwards) : done(blocks), blocks(blocks), first(backwards && blocks > 1 ? 1 : 0) {
        for (auto& d : done) d = false;
    }
    // The next block, or -1.
    int take() {
        const int i = next++, leading = first ? blocks / 2 : (blocks + 1) / 2;
        if (i >= blocks) return -1;
        if (i < leading) return 2 * i + first;
        const int block = 2 * (i - leading) + 1 - first;
        for (int neighbour : {block - 1, block + 1})
            while (neighbour >= 0 && neighbour < blocks && !done[neighbour].load(std::memory_order_acquire))
                std::this_thread::yield();
        return block;
    }
    void finish(int block) { done[block].store(true, std::memory_order_release); }
};

} // namespace

void descend(const Neighbourhood& n, const Sweep& sweep, SurrogateImages& data, float* f, const uint8_t* support) {
    const ScanGeometry& geometry = data.geometry;
    std::vector<Slab> order;
    for (const Slab& slab : slabs(geometry))
        if (slab.begin >= sweep.first && slab.end <= sweep.end) order.push_back(slab);
    if (order.empty()) return;
    if (sweep.backwards) std::reverse(order.begin(), order.end());
    int depth = 0;
    for (const Slab& slab : order) depth = std::max(depth, slab.end - slab.begin);
    SlabFootprints one(geometry, depth), two(geometry, depth), *now = &one, *next = &two;
    std::vector<Scratch> scratch(threads());
    now->start(order[0]);
    parallel(threads(), [&](int64_t, int64_t, int) { now->make(); });
    for (size_t i = 0; i < order.size(); i++) {
        const bool last = i + 1 == order.size();
        if (!last) next->start(order[i + 1]);
        const int rows = lanes * order[i].stride;
        BlockQueue queue(int((n.ny + rows - 1) / rows), sweep.backwards);
        parallel(threads(), [&](int64_t, int64_t, int thread) {
            for (int block; (block = queue.take()) >= 0; queue.finish(block))
                descend_block(*now, n, sweep, block, support, data, scratch[thread], f);
            if (!last) next->make();
        });
        std::swap(now, next);
    }
}

// d: (the group's rows, nx). Nothing is spread, so the rows may share pixels.
static void group_diagonal(const SliceFootprints& slice, const RowGroup& group, SurrogateImages& data, Scratch& s,
                           float* d) {
    const int nx = slice.geometry.grid.nx;
    for (int begin = 0; begin < nx; begin += voxels_at_once) {
        const int end = std::min(nx, begin + voxels_at_once);
        slice.gather(group, begin, end, data, s);
        for (int x = begin; x < end; x++) {
            f32x8 slope = {}, sum = {};
            add_derivatives(s.part.columns, x, slope, sum);
            slice.others.add_derivatives(group, x, data, s.part.footprints, slope, sum);
            for (int i = 0; i < group.rows; i++) d[int64_t(i) * nx + x] = sum[i];
        }
    }
}

void diagonal(SurrogateImages& data, int every, int every_row, float* d) {
    const Grid& grid = data.geometry.grid;
    const int rows = sampled(grid.ny, every_row);
    SliceFootprints slice(data.geometry);
    std::vector<Scratch> scratch(threads());
    for (int z = every / 2; z < grid.nz; z += every, d += int64_t(rows) * grid.nx) {
        parallel_tasks(slice.tasks(), [&](int64_t task, int) { slice.make(z, int(task)); });
        parallel((rows + lanes - 1) / lanes, [&](int64_t begin, int64_t end, int thread) {
            for (int64_t k = begin; k < end; k++) {
                const RowGroup group = row_group(int(k) * lanes * every_row + every_row / 2, every_row, grid.ny);
                group_diagonal(slice, group, data, scratch[thread], d + k * lanes * grid.nx);
            }
        });
    }
}

} // namespace palpate
