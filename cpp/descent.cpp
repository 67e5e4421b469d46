#include "descent.h"
#include "parallel.h"
#include "solve.h"
#include <algorithm>

namespace palpate {

Paraboloid::Paraboloid(const Geometry& geometry, const float* slope, const float* curvature)
    : images(geometry.views.size()) {
    parallel(int64_t(images.size()), [&](int64_t begin, int64_t end, int) {
        for (int64_t k = begin; k < end; k++) {
            const View& v = geometry.views[k];
            const Layout layout(v);
            const float *h1 = slope + k * geometry.pixels(), *h2 = curvature + k * geometry.pixels();
            Image& image = images[k];
            image.stride = layout.stride;
            image.slope.assign(layout.rows * layout.stride + column_padding, 0);
            image.curvature.assign(image.slope.size(), 0);
            for (int64_t row = 0; row < layout.rows; row++)
                for (int64_t column = 0; column < layout.columns; column++) {
                    const int64_t pixel = layout.start + row * layout.down + column * layout.right;
                    const float path = layout.separable ? v.path[pixel] : 1;
                    image.slope[row * image.stride + column] = h1[pixel] * path;
                    image.curvature[row * image.stride + column] = h2[pixel] * path * path;
                }
        }
    });
}

namespace {

constexpr int voxels_at_once = 256; // along x: what they need of all views stays in cache

// Columns of a view.
struct Columns {
    int begin, end;
};

// What one thread needs, made once a sweep.
struct Scratch {
    std::vector<Sums> sums; // per separable view
    std::vector<Columns> filled;
    std::vector<float> prior;
    Line line;
    Lists::Scratch lists;
};

// (rows) pointers to n floats each, to lanes: out[x * lanes + i] = rows[i][x]; absent rows are 0.
PALPATE_KERNEL void into_lanes(const float* const* rows, int count, int64_t n, float* out) {
    int64_t x = 0;
    for (; x + lanes <= n; x += lanes) {
        Lanes m[lanes] = {};
        for (int i = 0; i < count; i++) load(m[i], rows[i] + x);
        transpose(m);
        for (int i = 0; i < lanes; i++) store(out + (x + i) * lanes, m[i]);
    }
    for (; x < n; x++)
        for (int i = 0; i < lanes; i++) out[x * lanes + i] = i < count ? rows[i][x] : 0;
}

PALPATE_KERNEL void out_of_lanes(const float* in, int count, int64_t n, float* const* rows) {
    int64_t x = 0;
    for (; x + lanes <= n; x += lanes) {
        Lanes m[lanes];
        for (int i = 0; i < lanes; i++) load(m[i], in + (x + i) * lanes);
        transpose(m);
        for (int i = 0; i < count; i++) store(rows[i] + x, m[i]);
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
    int stride = 1;

    explicit Slice(const Geometry& g) : geometry(g), lists(g) {
        for (size_t k = 0; k < g.views.size(); k++)
            if (Layout(g.views[k]).separable) separable.push_back(int(k));
        views.resize(separable.size());
    }

    void make(int z) {
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
        stride = *std::max_element(apart.begin(), apart.end());
    }

    void begin(const Strip& strip, Scratch& s) const {
        s.sums.resize(views.size());
        s.line.views.resize(views.size());
        for (size_t k = 0; k < views.size(); k++) {
            const AxisTerms& x = views[k].x();
            views[k].begin(strip, s.sums[k]);
            s.line.views[k] = {x.weight.data(), x.first.data(), s.sums[k].cells.data(), x.terms, x.width};
        }
    }
};

// Those of voxels begin .. end - 1, to multiples of columns_at_once.
Columns columns(const AxisTerms& x, int begin, int end) {
    const int first = x.first[begin], last = x.first[end - 1] + x.width + columns_at_once - 1;
    return {first - first % columns_at_once, last - last % columns_at_once};
}

// Solves a strip part by part along x: the cells of a part's columns are filled before it, and its changes spread
// when no later part touches their columns.
void solve_strip(const Slice& slice, const Solve& solve, const Strip& strip, int step, Paraboloid& data, Scratch& s) {
    const int nx = slice.geometry.grid.nx, parts = (nx + voxels_at_once - 1) / voxels_at_once;
    std::vector<Columns>& filled = s.filled; // and not yet spread
    filled.assign(slice.views.size(), {-1, -1});
    slice.begin(strip, s);
    for (int i = 0; i < parts; i++) {
        const int part = step > 0 ? i : parts - 1 - i, next = part + step;
        const int begin = part * voxels_at_once, end = std::min(nx, begin + voxels_at_once);
        for (size_t k = 0; k < slice.views.size(); k++) {
            Columns &has = filled[k], wanted = columns(slice.views[k].x(), begin, end), missing = wanted;
            if (i > 0) (step > 0 ? missing.begin : missing.end) = step > 0 ? has.end : has.begin;
            if (i == 0) has = wanted;
            if (missing.begin >= missing.end) continue;
            const int view = slice.separable[k];
            slice.views[k].gather(strip, data.slope(view), data.curvature(view), missing.begin, missing.end, s.sums[k]);
            (step > 0 ? has.end : has.begin) = step > 0 ? missing.end : missing.begin;
        }
        solve.along(s.line, step > 0 ? begin : end - 1, end - begin, step, strip, data, s.lists);
        for (size_t k = 0; k < slice.views.size(); k++) {
            Columns &has = filled[k], done = has;
            if (i + 1 < parts) {
                const int from = next * voxels_at_once;
                const Columns later = columns(slice.views[k].x(), from, std::min(nx, from + voxels_at_once));
                (step > 0 ? done.end : done.begin) =
                    step > 0 ? std::min(later.begin, has.end) : std::max(later.end, has.begin);
            }
            const int view = slice.separable[k];
            slice.views[k].spread(strip, data.curvature(view), done.begin, done.end, s.sums[k], data.slope(view));
            (step > 0 ? has.begin : has.end) = step > 0 ? done.end : done.begin;
        }
    }
}

void descend_strip(const Slice& slice, const Solve& solve, int z, const Strip& strip, bool backwards, Paraboloid& data,
                   Scratch& s, float* f) {
    const Neighbourhood& n = solve.neighbours;
    const int64_t nx = n.nx;
    float* rows[lanes];
    for (int i = 0; i < strip.rows; i++) rows[i] = f + (z * n.ny + strip.y[i]) * nx;
    s.line.f.resize((nx + 2) * lanes);
    into_lanes(rows, strip.rows, nx, s.line.f.data() + lanes);
    if (solve.beta > 0) {
        s.prior.resize(2 * lanes * nx);
        float *gradient[lanes], *curvature[lanes];
        for (int i = 0; i < strip.rows; i++) {
            gradient[i] = s.prior.data() + 2 * i * nx;
            curvature[i] = gradient[i] + nx;
            prior_across_rows(n, f, z, strip.y[i], gradient[i], curvature[i]);
        }
        s.line.gradient.resize(nx * lanes);
        s.line.curvature.resize(nx * lanes);
        into_lanes(gradient, strip.rows, nx, s.line.gradient.data());
        into_lanes(curvature, strip.rows, nx, s.line.curvature.data());
    }
    solve_strip(slice, solve, strip, backwards ? -1 : 1, data, s);
    out_of_lanes(s.line.f.data() + lanes, strip.rows, nx, rows);
}

// d: the slice's, (ny, nx). Nothing is spread, so the rows may share pixels.
void strip_diagonal(const Slice& slice, const Strip& strip, Paraboloid& data, Scratch& s, float* d) {
    const int nx = slice.geometry.grid.nx;
    slice.begin(strip, s);
    for (size_t k = 0; k < slice.views.size(); k++) {
        const Columns all = columns(slice.views[k].x(), 0, nx);
        const float* curvature = data.curvature(slice.separable[k]);
        slice.views[k].gather(strip, curvature, curvature, all.begin, all.end, s.sums[k]);
    }
    s.line.f.resize(int64_t(nx) * lanes);
    line_curvature(s.line, 0, nx, s.line.f.data());
    for (int x = 0; x < nx && !slice.lists.empty(); x++) {
        Lanes slope = {}, sum;
        load(sum, &s.line.f[int64_t(x) * lanes]);
        slice.lists.measure(strip, x, data, s.lists, slope, sum);
        store(&s.line.f[int64_t(x) * lanes], sum);
    }
    float* rows[lanes];
    for (int i = 0; i < strip.rows; i++) rows[i] = d + int64_t(strip.y[i]) * nx;
    out_of_lanes(s.line.f.data(), strip.rows, nx, rows);
}

// The i-th strip of eight rows first, first + stride, ... of ny.
Strip strip_of(int64_t i, int64_t first, int64_t stride, int64_t ny) {
    Strip strip;
    for (int64_t y = first + i * lanes * stride; y < ny && strip.rows < lanes; y += stride)
        strip.y[strip.rows++] = int(y);
    return strip;
}

} // namespace

void descend(const Geometry& geometry, const Neighbourhood& n, const Sweep& sweep, Paraboloid& data, float* f) {
    Slice slice(geometry);
    const Solve solve{n, sweep.beta, sweep.relaxation, slice.lists};
    std::vector<Scratch> scratch(threads());
    for (int64_t i = 0; i < n.nz; i++) {
        const int z = int(sweep.backwards ? n.nz - 1 - i : i);
        slice.make(z);
        const int64_t stride = std::max(2, slice.stride); // neighbouring rows are bound by the prior
        const int64_t classes = std::min<int64_t>(stride, n.ny);
        for (int64_t j = 0; j < classes; j++) {
            const int64_t first = sweep.backwards ? classes - 1 - j : j, rows = (n.ny - first + stride - 1) / stride;
            parallel((rows + lanes - 1) / lanes, [&](int64_t begin, int64_t end, int thread) {
                for (int64_t k = begin; k < end; k++)
                    descend_strip(slice, solve, z, strip_of(k, first, stride, n.ny), sweep.backwards, data,
                                  scratch[thread], f);
            });
        }
    }
}

void diagonal(const Geometry& geometry, Paraboloid& data, float* d) {
    const Grid& grid = geometry.grid;
    Slice slice(geometry);
    std::vector<Scratch> scratch(threads());
    for (int z = 0; z < grid.nz; z++) {
        slice.make(z);
        parallel((grid.ny + lanes - 1) / lanes, [&](int64_t begin, int64_t end, int thread) {
            for (int64_t k = begin; k < end; k++)
                strip_diagonal(slice, strip_of(k, 0, 1, grid.ny), data, scratch[thread], d + z * grid.slice());
        });
    }
}

int row_stride(const Geometry& geometry, int z) {
    Slice slice(geometry);
    slice.make(z);
    return slice.stride;
}

} // namespace palpate
