#include "turned.h"
#include "parallel.h"
#include "taps.h"

namespace palpate {
namespace {

// image[b, a] += sum over the voxels y above pixel b of columns[y, a] * weight, for columns begin to end. Numerical
// kernel.
PALPATE_KERNEL void rows_to_pixels(const double* __restrict slope1, const double* __restrict offset1,
                                   const double* __restrict slope2, const double* __restrict offset2, int voxels,
                                   int ny, int stride, const float* __restrict columns, int nb, int na, int64_t begin,
                                   int64_t end, float* __restrict image) {
    for (int b = 0; b < nb; b++) {
        const double q = b - 0.5;
        float* row = image + int64_t(b) * na;
        for (int64_t a = begin; a < end; a++) {
            // The first voxel whose upper edge passes q at either end of its move.
            const double y1 = (q - offset1[a]) / slope1[a], y2 = (q - offset2[a]) / slope2[a];
            const int y0 = int(std::min(std::max(std::floor(std::min(y1, y2)), 0.0), double(ny)));
            double before = covered(slope1[a] * y0 + offset1[a], slope2[a] * y0 + offset2[a], q);
            float sum = 0;
            for (int t = 0; t < voxels; t++) {
                const int y = y0 + t + 1; // upper edge; rows beyond the grid are padding that holds 0
                const double after = covered(slope1[a] * y + offset1[a], slope2[a] * y + offset2[a], q);
                sum += float(after - before) * columns[int64_t(y - 1) * stride + (a - begin)];
                before = after;
            }
            row[a] += sum;
        }
    }
}

// columns[y, a] = sum over the pixels b under voxel y of image[b, a] * weight. Numerical kernel.
PALPATE_KERNEL void pixels_to_row(const double* __restrict slope1, const double* __restrict offset1,
                                  const double* __restrict slope2, const double* __restrict offset2, int taps, int y,
                                  int nb, int na, const float* __restrict image, float* __restrict column) {
    for (int a = 0; a < na; a++) {
        const double l1 = slope1[a] * y + offset1[a], l2 = slope2[a] * y + offset2[a];
        const double r1 = slope1[a] * (y + 1) + offset1[a], r2 = slope2[a] * (y + 1) + offset2[a];
        const int b0 = int(std::min(std::max(std::floor(std::min(l1, l2) + 0.5), 0.0), double(nb)));
        float sum = 0;
        for (int t = 0; t < taps; t++) {
            const double q = b0 + t - 0.5; // rows beyond the image are padding that holds 0
            sum += float(covered(r1, r2, q) - covered(l1, l2, q)) * image[int64_t(b0 + t) * na + a];
        }
        column[a] = sum;
    }
}

} // namespace

void project_turned(const Geometry& g, const View& v, const float* f, float* image) {
    const Grid grid = g.seen_by(v);
    std::fill_n(image, int64_t(v.nb) * v.na, 0.0f);
    constexpr int block = 64; // columns that one thread owns at a time
    parallel((v.na + block - 1) / block, [&](int64_t begin, int64_t end, int) {
        AxisWeights voxels, wx;
        Rows wy;
        std::vector<float> columns, row;
        for (int i = 0; i < grid.nz * v.subs; i++) {
            by_voxel(g, v, i / v.subs, i % v.subs, Axis::x, voxels);
            by_pixel(voxels, v.na, wx);
            rows(g, v, i / v.subs, i % v.subs, wy);
            const int64_t a0 = begin * block, a1 = std::min<int64_t>(end * block, v.na), width = a1 - a0;
            columns.assign((grid.ny + wy.voxels + 1) * width, 0.0f);
            row.assign(grid.nx + wx.taps, 0.0f);
            const float* slice = f + (i / v.subs) * grid.slice();
            for (int y = 0; y < grid.ny; y++) {
                std::copy_n(slice + int64_t(y) * grid.nx, grid.nx, row.begin());
                for (int t = 0; t < wx.taps; t++)
                    add_taps(int(width), 1, wx.first.data() + a0, &wx.weight[size_t(t) * v.na + a0], row.data() + t,
                             &columns[y * width]);
            }
            rows_to_pixels(wy.slope1.data(), wy.offset1.data(), wy.slope2.data(), wy.offset2.data(), wy.voxels, grid.ny,
                           int(width), columns.data(), v.nb, v.na, a0, a1, image);
        }
    });
}

void backproject_turned(const Geometry& g, const View& v, const float* image, float* f) {
    const Grid grid = g.seen_by(v);
    Rows most;
    int padding = 0;
    for (int z : {0, grid.nz - 1})
        for (int sub : {0, v.subs - 1}) {
            rows(g, v, z, sub, most);
            padding = std::max(padding, most.taps + 1);
        }
    std::vector<float> padded(int64_t(v.nb + padding) * v.na, 0.0f);
    std::copy_n(image, int64_t(v.nb) * v.na, padded.begin());
    parallel(grid.nz, [&](int64_t begin, int64_t end, int) {
        AxisWeights wx;
        Rows wy;
        std::vector<float> column;
        for (int64_t i = begin * v.subs; i < end * v.subs; i++) {
            by_voxel(g, v, int(i / v.subs), int(i % v.subs), Axis::x, wx);
            rows(g, v, int(i / v.subs), int(i % v.subs), wy);
            column.assign(v.na + wx.taps, 0.0f);
            float* slice = f + (i / v.subs) * grid.slice();
            for (int y = 0; y < grid.ny; y++) {
                pixels_to_row(wy.slope1.data(), wy.offset1.data(), wy.slope2.data(), wy.offset2.data(),
                              std::min(wy.taps, padding), y, v.nb, v.na, padded.data(), column.data());
                add_taps(grid.nx, wx.taps, wx.first.data(), wx.weight.data(), column.data(),
                         slice + int64_t(y) * grid.nx);
            }
        }
    });
}

} // namespace palpate
