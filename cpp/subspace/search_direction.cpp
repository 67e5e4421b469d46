#include "base/cpu_dispatch.h"
#include "base/simd.h"
#include "base/thread_pool.h"
#include "subspace/memory_gradient.h"
#include <algorithm>
#include <vector>

namespace palpate {
namespace {

// Eight voxels of a row against the three neighbours of each in another row, at x - 1, x and x + 1.
constexpr int trio = 3;

// A row of neighbours, at the same x, and their weights ω.
struct NeighbourRow {
    int64_t offset; // from the voxel's row, elements
    float weight[trio];
};

// ψ'(t)/t of three times eight differences. Lange's divides once for three: a division costs as much as ten products.
template <Potential potential>
PALPATE_INLINE void curvatures(const PotentialParameters& law, const f32x8 (&t)[trio], f32x8 (&k)[trio]) {
    if constexpr (potential == Potential::lange) {
        f32x8 d[trio];
        PALPATE_UNROLL
        for (int i = 0; i < trio; i++) {
            magnitude(t[i], d[i]);
            d[i] += law.edge;
        }
        const f32x8 first = d[0] * d[1], all = law.edge / (first * d[2]), rest = all * d[2];
        k[0] = rest * d[1];
        k[1] = rest * d[0];
        k[2] = all * first;
    } else {
        float in[trio * lanes], out[trio * lanes];
        for (int i = 0; i < trio; i++) store(in + i * lanes, t[i]);
        for (int i = 0; i < trio * lanes; i++) out[i] = potential_curvature<potential>(law, in[i]);
        for (int i = 0; i < trio; i++) load(k[i], out + i * lanes);
    }
}

PALPATE_INLINE void load_trio(const float* row, int64_t x, f32x8 (&b)[trio]) {
    load(b[0], row + x - 1);
    load(b[1], row + x);
    load(b[2], row + x + 1);
}

// The rows of neighbours of row (z, y) that exist, its own among them.
int neighbour_rows(const Neighbourhood& n, int64_t z, int64_t y, NeighbourRow (&rows)[9]) {
    int count = 0;
    for (int64_t dz = -1; dz <= 1; dz++)
        for (int64_t dy = -1; dy <= 1; dy++) {
            if (z + dz < 0 || z + dz >= n.nz || y + dy < 0 || y + dy >= n.ny) continue;
            const float* w = n.weight[dz + 1][dy + 1];
            if (w[0] != 0 || w[1] != 0 || w[2] != 0) rows[count++] = {(dz * n.ny + dy) * n.nx, {w[0], w[1], w[2]}};
        }
    return count;
}

// A voxel's sums over all its neighbours: slope Σ ω ψ'(t) and bend Σ ω ψ'(t)/t.
template <Potential potential>
PALPATE_INLINE void sum_one(const PotentialParameters& law, const NeighbourRow* rows, int count, const float* own,
                            int64_t x, int64_t nx, float* slope, float* bend) {
    float slopes = 0, curvature_sum = 0;
    for (int r = 0; r < count; r++)
        for (int64_t i = x > 0 ? 0 : 1; i < (x + 1 < nx ? trio : 2); i++) {
            const float t = own[x] - own[rows[r].offset + x + i - 1];
            const float k = rows[r].weight[i] * potential_curvature<potential>(law, t);
            slopes += k * t;
            curvature_sum += k;
        }
    slope[x] = slopes;
    bend[x] = curvature_sum;
}

template <Potential potential>
PALPATE_INLINE void sum_eight(const PotentialParameters& law, const NeighbourRow* rows, int count, const float* own,
                              int64_t x, float* slope, float* bend) {
    f32x8 a, slopes[trio] = {}, curvature_sum = {};
    load(a, own + x);
    for (int r = 0; r < count; r++) {
        f32x8 t[trio], k[trio];
        load_trio(own + rows[r].offset, x, t);
        PALPATE_UNROLL
        for (int i = 0; i < trio; i++) t[i] = a - t[i];
        curvatures<potential>(law, t, k);
        PALPATE_UNROLL
        for (int i = 0; i < trio; i++) {
            k[i] *= rows[r].weight[i];
            slopes[i] += k[i] * t[i]; // three sums: none waits for another
        }
        curvature_sum += k[0] + k[1] + k[2];
    }
    store(slope + x, slopes[0] + slopes[1] + slopes[2]);
    store(bend + x, curvature_sum);
}

// Numerical kernel. The first and the last voxel have neighbours outside the row; the last eight between them may have
// been made in part before.
template <Potential potential>
PALPATE_INLINE void sum_row(const PotentialParameters& given, const NeighbourRow* rows, int count, const float* own,
                            int64_t nx, float* slope, float* bend) {
    const PotentialParameters law = given;
    if (nx < lanes + 2) {
        for (int64_t x = 0; x < nx; x++) sum_one<potential>(law, rows, count, own, x, nx, slope, bend);
        return;
    }
    sum_one<potential>(law, rows, count, own, 0, nx, slope, bend);
    for (int64_t x = 1; x < nx - 1; x += lanes)
        sum_eight<potential>(law, rows, count, own, std::min(x, nx - 1 - lanes), slope, bend);
    sum_one<potential>(law, rows, count, own, nx - 1, nx, slope, bend);
}

PALPATE_KERNEL void sum_neighbours(const PotentialParameters& law, const NeighbourRow* rows, int count,
                                   const float* own, int64_t nx, float* slope, float* bend) {
    PALPATE_RETURN_FOR_POTENTIAL(law.potential, sum_row, law, rows, count, own, nx, slope, bend);
}

// A row of the data's curvature from two rows of the coarse map: linear between the middles of its cells, constant
// beyond the outermost.
PALPATE_KERNEL void refine_row(const float* low, const float* high, float share, int64_t cells, int64_t step,
                               int64_t nx, float* coarse, float* row) {
    for (int64_t i = 0; i < cells; i++) coarse[i] = low[i] + share * (high[i] - low[i]);
    if (step == 1) {
        std::copy_n(coarse, nx, row);
        return;
    }
    const int64_t half = step / 2;
    for (int64_t x = 0; x < std::min(half, nx); x++) row[x] = coarse[0];
    for (int64_t i = 0; i < cells; i++) {
        const float from = coarse[i], by = (i + 1 < cells ? coarse[i + 1] - from : 0) / float(step);
        float* out = row + i * step + half; // the buffer reaches one cell beyond the row
        if (step == coarse_step)
            for (int64_t k = 0; k < coarse_step; k++) out[k] = from + (float(k) + 0.5f) * by;
        else
            for (int64_t k = 0; k < step; k++) out[k] = from + (float(k) + 0.5f) * by;
    }
}

// What turns a row of the gradient into the direction.
struct Turn {
    const float *slope, *bend, *data, *f, *previous;
    float beta;

    PALPATE_INLINE void one(int64_t x, float* gradient, float& along, float& back) const {
        const float g = gradient[x] + beta * slope[x], bent = data[x] + 2 * beta * bend[x];
        const bool held = !(bent > 0) | ((f[x] <= 0) & (g > 0));
        const float v = held ? 0.0f : -g / (held ? 1.0f : bent);
        gradient[x] = v;
        along += g * v;
        back += g * (f[x] - previous[x]);
    }
};

PALPATE_KERNEL void turn_row(const float* __restrict slope, const float* __restrict bend, const float* __restrict data,
                             float beta, const float* __restrict f, const float* __restrict previous, int64_t nx,
                             float* __restrict gradient, double* sums) {
    float along[lanes] = {}, back[lanes] = {};
    const Turn turn{slope, bend, data, f, previous, beta};
    int64_t x = 0;
    for (; x + lanes <= nx; x += lanes)
        for (int k = 0; k < lanes; k++) turn.one(x + k, gradient, along[k], back[k]);
    for (; x < nx; x++) turn.one(x, gradient, along[0], back[0]);
    for (int k = 0; k < lanes; k++) sums[0] += along[k], sums[1] += back[k];
}

struct Rows {
    std::vector<float> slope, bend, data, coarse;
    Rows(int64_t nx, int64_t cells)
        : slope(nx), bend(nx), data(std::max(nx, (cells + 2) * coarse_step)), coarse(cells) {}
};

} // namespace

void search_direction(const Neighbourhood& n, const Majorizer& data, float beta, const float* f, const float* previous,
                      Slices slices, float* u, double slopes[2]) {
    const int64_t count = (slices.end - slices.first) * n.ny;
    std::vector<double> sums(2 * count); // a pair a row: the total does not depend on the number of threads
    parallel(count, [&](int64_t begin, int64_t end, int) {
        Rows rows(n.nx, data.nx);
        for (int64_t part = begin; part < end; part++) {
            const int64_t index = slices.first * n.ny + part, z = index / n.ny, y = index % n.ny, here = index * n.nx;
            const double at = data.step == 1 ? double(y) : (double(y) + 0.5) / double(data.step) - 0.5;
            const double held = std::min(std::max(at, 0.0), double(data.ny - 1));
            const int64_t low = int64_t(held), high = std::min(low + 1, data.ny - 1);
            const float* slice = data.values + z * data.ny * data.nx;
            refine_row(slice + low * data.nx, slice + high * data.nx, float(held - double(low)), data.nx, data.step,
                       n.nx, rows.coarse.data(), rows.data.data());
            if (beta > 0) {
                NeighbourRow around[9];
                const int neighbours = neighbour_rows(n, z, y, around);
                sum_neighbours(n.law, around, neighbours, f + here, n.nx, rows.slope.data(), rows.bend.data());
                leave_out_border(n, f + here, z, y, 0, n.nx, rows.slope.data(), rows.bend.data());
            }
            turn_row(rows.slope.data(), rows.bend.data(), rows.data.data(), beta, f + here, previous + here, n.nx,
                     u + here, &sums[2 * part]);
        }
    });
    slopes[0] = slopes[1] = 0;
    for (size_t k = 0; k < sums.size(); k++) slopes[k % 2] += sums[k];
}

} // namespace palpate
