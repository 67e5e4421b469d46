// The separable projector: each sub-slice is resampled onto the panel by two passes of short 1-D sums,
// A_k = path * sum over sub-slices of W^y x W^x, and back by the same two passes with the weights read the other way.
//
// Both passes work on 16 rows of the result at once, one a lane: the first is a small dense product (rows of the source
// times a 16-column table), the second scales whole vectors of 16. So neither gathers nor shuffles, whatever the
// weights.
#include "projector.h"
#include "dispatch.h"
#include "parallel.h"
#include "turned.h"
#include "weights.h"
#include <algorithm>
#include <cstring>

namespace palpate {

constexpr int lanes = 16;
typedef float Lanes __attribute__((vector_size(4 * lanes), aligned(4))); // the compiler halves it where registers do

// out[i] = sum over r of source[r * stride + i] * table[r], i from begin to end.
PALPATE_KERNEL void mix_lanes(const float* source, int64_t stride, int rows, const float* table_, int begin, int end,
                              float* out_) {
    const Lanes* table = reinterpret_cast<const Lanes*>(table_);
    Lanes* out = reinterpret_cast<Lanes*>(out_);
    int i = begin;
    for (; i + 8 <= end; i += 8) {
        Lanes s0{}, s1{}, s2{}, s3{}, s4{}, s5{}, s6{}, s7{};
        const float* x = source + i;
        for (int r = 0; r < rows; r++, x += stride) {
            const Lanes w = table[r];
            s0 += w * x[0], s1 += w * x[1], s2 += w * x[2], s3 += w * x[3];
            s4 += w * x[4], s5 += w * x[5], s6 += w * x[6], s7 += w * x[7];
        }
        out[i] = s0, out[i + 1] = s1, out[i + 2] = s2, out[i + 3] = s3;
        out[i + 4] = s4, out[i + 5] = s5, out[i + 6] = s6, out[i + 7] = s7;
    }
    for (; i < end; i++) {
        Lanes s{};
        const float* x = source + i;
        for (int r = 0; r < rows; r++, x += stride) s += table[r] * x[0];
        out[i] = s;
    }
}

// out[j] += sum over t of weight[t * n + j] * in[first[j] + t], j from begin to end.
PALPATE_KERNEL void spread_lanes(const float* in_, const int32_t* first, const float* weight, int taps, int n,
                                 int begin, int end, float* out_) {
    const Lanes* in = reinterpret_cast<const Lanes*>(in_);
    Lanes* out = reinterpret_cast<Lanes*>(out_);
    for (int j = begin; j < end; j++) {
        const Lanes* x = in + first[j];
        const float* w = weight + j;
        Lanes s = out[j];
        for (int t = 0; t < taps; t++, w += n) s += x[t] * *w;
        out[j] = s;
    }
}

namespace {

constexpr int strip = 8 * lanes; // rows of the result that one task owns: its sums stay in the second-level cache

struct Range {
    int begin, end;
};

// Elements of the result with any weight.
Range reached(const AxisWeights& w) {
    Range range{w.n, 0};
    for (int t = 0; t < w.taps; t++) {
        const float* row = &w.weight[size_t(t) * w.n];
        int i = 0, j = w.n;
        while (i < range.begin && row[i] == 0) i++;
        while (j > range.end && row[j - 1] == 0) j--;
        range = {std::min(range.begin, i), std::max(range.end, j)};
    }
    return range;
}

// The weights of one sub-slice, read in the direction of the result: along each row of it, and across its rows.
struct Weights {
    AxisWeights along, across;
    Range columns, sources; // of the result, and of the source, along a row
};

// The first pass's dense table for rows `row` to row + 16 of the result: 16 weights for each row of the source.
struct Table {
    std::vector<float> weight;
    int first = 0, rows = 0;

    void fill(const AxisWeights& w, int row) {
        const int count = std::min(lanes, w.n - row);
        int low = INT32_MAX, high = -1;
        for (int t = 0; t < w.taps; t++)
            for (int l = 0; l < count; l++) {
                if (w.weight[size_t(t) * w.n + row + l] == 0) continue;
                low = std::min(low, w.first[row + l] + t);
                high = std::max(high, w.first[row + l] + t);
            }
        first = low;
        rows = std::max(0, high - low + 1);
        if (high < 0) return;
        weight.assign(size_t(rows) * lanes, 0);
        for (int t = 0; t < w.taps; t++)
            for (int l = 0; l < count; l++) {
                const float value = w.weight[size_t(t) * w.n + row + l];
                if (value != 0) weight[size_t(w.first[row + l] + t - first) * lanes + l] = value;
            }
    }
};

// Scratch of one task, kept between its slices.
struct Scratch {
    std::vector<Weights> subs;
    AxisWeights voxels;
    Table table;
    std::vector<float> mixed, sum; // 16 lanes each: along a source row; along the rows of the strip
};

// Adds one slice of one view to rows `begin` to `end` of the result. source: image whose rows are `stride` long.
void add_slice(Scratch& scratch, const float* source, int64_t stride, int begin, int end, int width) {
    for (int row = begin; row < end; row += lanes)
        for (const Weights& w : scratch.subs) {
            if (w.columns.begin >= w.columns.end) continue;
            scratch.table.fill(w.across, row);
            if (scratch.table.rows == 0) continue;
            mix_lanes(source + scratch.table.first * stride, stride, scratch.table.rows, scratch.table.weight.data(),
                      w.sources.begin, w.sources.end, scratch.mixed.data());
            spread_lanes(scratch.mixed.data(), w.along.first.data(), w.along.weight.data(), w.along.taps, w.along.n,
                         w.columns.begin, w.columns.end, &scratch.sum[size_t(row - begin) * width]);
        }
}

// Weights of a slice.
void weigh(const Geometry& g, const View& v, int z, bool per_pixel, Scratch& s) {
    s.subs.resize(v.subs);
    for (int sub = 0; sub < v.subs; sub++) {
        Weights& w = s.subs[sub];
        by_voxel(g, v, z, sub, Axis::x, per_pixel ? s.voxels : w.along);
        if (per_pixel) by_pixel(s.voxels, v.na, w.along);
        by_voxel(g, v, z, sub, Axis::y, per_pixel ? s.voxels : w.across);
        if (per_pixel) by_pixel(s.voxels, v.nb, w.across);
        w.columns = reached(w.along);
        w.sources = {INT32_MAX, 0}; // the second pass reads all taps of the columns reached
        for (int j = w.columns.begin; j < w.columns.end; j++) {
            w.sources.begin = std::min(w.sources.begin, int(w.along.first[j]));
            w.sources.end = std::max(w.sources.end, int(w.along.first[j]) + w.along.taps);
        }
    }
}

// sum (rows / 16, width, 16) -> rows of `out`, out[row * step_row + column * step_column].
void untangle(const std::vector<float>& sum, int begin, int end, int width, float* out, int64_t step_row,
              int64_t step_column) {
    for (int row = begin; row < end; row++) {
        const float* from = &sum[size_t((row - begin) / lanes) * width * lanes + (row - begin) % lanes];
        float* to = out + row * step_row;
        for (int column = 0; column < width; column++) to[column * step_column] = from[size_t(column) * lanes];
    }
}

size_t padded(int rows, int width) { return size_t(rows + lanes - 1) / lanes * lanes * width; }

// One strip of virtual-panel rows of one view, from all slices.
void project_strip(const Geometry& g, const View& v, const float* f, int begin, int end, float* image, Scratch& s) {
    s.sum.assign(padded(end - begin, v.na), 0);
    s.mixed.resize(size_t(g.grid.nx) * lanes);
    for (int z = 0; z < g.grid.nz; z++) {
        weigh(g, v, z, true, s);
        add_slice(s, f + z * g.grid.slice(), g.grid.nx, begin, end, v.na);
    }
    if (v.pose == Pose::tilted)
        untangle(s.sum, begin, end, v.na, image, v.na, 1);
    else
        untangle(s.sum, begin, end, v.na, image + v.start, v.step_b, v.step_a);
}

struct Strip {
    int owner, begin, end; // owner: a view or a slice
};

std::vector<Strip> strips_of(int owner, int rows) {
    std::vector<Strip> strips;
    for (int row = 0; row < rows; row += strip) strips.push_back({owner, row, std::min(rows, row + strip)});
    return strips;
}

// Measured pixels, scaled by path -> the virtual panel, rows along y.
void to_virtual(const View& v, const float* p, float* image) {
    if (v.pose != Pose::tilted) {
        for (int64_t b = 0; b < v.nb; b++)
            for (int64_t a = 0; a < v.na; a++) {
                const int64_t i = v.start + b * v.step_b + a * v.step_a;
                image[b * v.na + a] = p[i] * v.path[i];
            }
        return;
    }
    const Sparse& rows = v.resampling.fine;
    for (int64_t i = 0; i < int64_t(v.nb) * v.na; i++) {
        float sum = 0;
        for (int64_t e = rows.offset[i]; e < rows.offset[i + 1]; e++)
            sum += rows.weight[e] * (p[rows.index[e]] * v.path[rows.index[e]]);
        image[i] = sum;
    }
}

// The views that the lanes serve: all but the turned ones.
void project_separable(const Geometry& g, const float* f, float* p) {
    const int views = int(g.views.size());
    std::vector<std::vector<float>> fine(views); // images of tilted panels, to be resampled
    std::vector<Strip> strips;
    for (int k = 0; k < views; k++) {
        const View& v = g.views[k];
        if (v.pose == Pose::turned) continue;
        if (v.pose == Pose::tilted) fine[k].resize(size_t(v.na) * v.nb);
        for (const Strip& s : strips_of(k, v.nb)) strips.push_back(s);
    }
    parallel(int64_t(strips.size()), [&](int64_t begin, int64_t end, int) {
        Scratch scratch;
        for (int64_t i = begin; i < end; i++) {
            const auto [k, b0, b1] = strips[i];
            float* image = g.views[k].pose == Pose::tilted ? fine[k].data() : p + k * g.pixels();
            project_strip(g, g.views[k], f, b0, b1, image, scratch);
        }
    });
    for (int k = 0; k < views; k++)
        if (g.views[k].pose == Pose::tilted) apply(g.views[k].resampling.measured, fine[k].data(), p + k * g.pixels());
}

// Writes all of f, with what those views add to it.
void backproject_separable(const Geometry& g, const float* p, float* f) {
    const int views = int(g.views.size());
    const Grid& grid = g.grid;
    std::vector<std::vector<float>> images(views);
    parallel(views, [&](int64_t begin, int64_t end, int) {
        for (int64_t k = begin; k < end; k++) {
            const View& v = g.views[k];
            if (v.pose == Pose::turned) continue;
            images[k].resize(size_t(v.na) * v.nb);
            to_virtual(v, p + k * g.pixels(), images[k].data());
        }
    });
    std::vector<Strip> strips;
    for (int z = 0; z < grid.nz; z++)
        for (const Strip& s : strips_of(z, grid.ny)) strips.push_back(s);
    parallel(int64_t(strips.size()), [&](int64_t begin, int64_t end, int) {
        Scratch s;
        for (int64_t i = begin; i < end; i++) {
            const auto [z, y0, y1] = strips[i];
            s.sum.assign(padded(y1 - y0, grid.nx), 0);
            for (int k = 0; k < views; k++) {
                const View& v = g.views[k];
                if (v.pose == Pose::turned) continue;
                weigh(g, v, z, false, s);
                s.mixed.resize(std::max(s.mixed.size(), size_t(v.na) * lanes));
                add_slice(s, images[k].data(), v.na, y0, y1, grid.nx);
            }
            untangle(s.sum, y0, y1, grid.nx, f + z * grid.slice(), grid.nx, 1);
        }
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
        float* measured = p + k * g.pixels();
        if (v.pose == Pose::turned) {
            image.resize(size_t(v.nb) * v.na);
            project_turned(g, v, v.swapped ? exchanged.data() : f, image.data());
            for (int64_t b = 0; b < v.nb; b++)
                for (int64_t a = 0; a < v.na; a++)
                    measured[v.start + b * v.step_b + a * v.step_a] = image[b * v.na + a];
        }
        parallel(g.pixels(), [&](int64_t begin, int64_t end, int) {
            for (int64_t i = begin; i < end; i++) measured[i] *= v.path[i];
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
        to_virtual(v, p + k * g.pixels(), image.data());
        backproject_turned(g, v, image.data(), v.swapped ? exchanged.data() : f);
    }
    if (!exchanged.empty()) exchange(exchanged.data(), grid.nz, grid.nx, grid.ny, true, f);
}

} // namespace palpate
