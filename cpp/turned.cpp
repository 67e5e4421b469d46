#include "turned.h"
#include "parallel.h"
#include "taps.h"

namespace palpate {

constexpr int block = 64; // columns that the kernels below treat together, in registers and the first-level cache

// image[b, a] += sum over the voxels y above pixel b of columns[y, a] * weight, for columns begin to end. Numerical
// kernel.
PALPATE_KERNEL void rows_to_pixels(const double* __restrict slope1, const double* __restrict offset1,
                                   const double* __restrict slope2, const double* __restrict offset2, int voxels,
                                   int ny, int stride, const float* __restrict columns, int nb, int na, int64_t begin,
                                   int64_t end, float* __restrict image) {
    int32_t y0[block];
    double before[block];
    float sum[block];
    for (int64_t a0 = begin; a0 < end; a0 += block) {
        const int n = int(std::min<int64_t>(block, end - a0));
        const double *s1 = slope1 + a0, *o1 = offset1 + a0, *s2 = slope2 + a0, *o2 = offset2 + a0;
        const float* from = columns + (a0 - begin);
        for (int b = 0; b < nb; b++) {
            const double q = b - 0.5;
            for (int a = 0; a < n; a++) {
                // The first voxel whose upper edge passes q at either end of its move.
                const double y1 = (q - o1[a]) / s1[a], y2 = (q - o2[a]) / s2[a];
                const double y = std::min(std::max(std::floor(std::min(y1, y2)), 0.0), double(ny));
                y0[a] = int32_t(y);
                before[a] = covered(s1[a] * y + o1[a], s2[a] * y + o2[a], q);
                sum[a] = 0;
            }
            for (int t = 0; t < voxels; t++)
                for (int a = 0; a < n; a++) {
                    const double y = y0[a] + t + 1; // upper edge; rows beyond the grid are padding that holds 0
                    const double after = covered(s1[a] * y + o1[a], s2[a] * y + o2[a], q);
                    sum[a] += float(after - before[a]) * from[(y0[a] + t) * stride + a];
                    before[a] = after;
                }
            float* row = image + int64_t(b) * na + a0;
            for (int a = 0; a < n; a++) row[a] += sum[a];
        }
    }
}

// columns[y, a] = sum over the pixels b under voxel y of image[b, a] * weight. Numerical kernel.
PALPATE_KERNEL void pixels_to_row(const double* __restrict slope1, const double* __restrict offset1,
                                  const double* __restrict slope2, const double* __restrict offset2, int taps, int y,
                                  int nb, int na, const float* __restrict image, float* __restrict column) {
    int32_t b0[block];
    float sum[block];
    for (int a0 = 0; a0 < na; a0 += block) {
        const int n = std::min(block, na - a0);
        const double *s1 = slope1 + a0, *o1 = offset1 + a0, *s2 = slope2 + a0, *o2 = offset2 + a0;
        for (int a = 0; a < n; a++) {
            const double l1 = s1[a] * y + o1[a], l2 = s2[a] * y + o2[a];
            b0[a] = int32_t(std::min(std::max(std::floor(std::min(l1, l2) + 0.5), 0.0), double(nb)));
            sum[a] = 0;
        }
        for (int t = 0; t < taps; t++)
            for (int a = 0; a < n; a++) {
                const double q = b0[a] + t - 0.5; // rows beyond the image are padding that holds 0
                const double l1 = s1[a] * y + o1[a], l2 = s2[a] * y + o2[a];
                const double w = covered(l1 + s1[a], l2 + s2[a], q) - covered(l1, l2, q);
                sum[a] += float(w) * image[(b0[a] + t) * na + a0 + a];
            }
        for (int a = 0; a < n; a++) column[a0 + a] = sum[a];
    }
}

void project_turned(const Geometry& g, const View& v, const float* f, float* image) {
    const Grid grid = g.seen_by(v);
    std::fill_n(image, int64_t(v.nb) * v.na, 0.0f);
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
