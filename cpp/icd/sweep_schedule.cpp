#include "icd/sweep_schedule.h"
#include "base/simd.h"
#include "base/thread_pool.h"
#include "icd/rotated_panel_rows.h"
#include "icd/sparse_footprints.h"
#include "icd/view_layout.h"
#include "projection/footprint_weights.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr int most_slices = 8;
constexpr int64_t most_weights = 200'000; // roughly: voxels of a row times products squared, of all slices of a slab

// Where the rows of voxels of one slice land on a parallel panel: the edges below row y at the slice's two faces.
EdgeProjection faces(const ScanGeometry& geometry, const View& view, int z) {
    const Axis axis = view.swapped ? Axis::x : Axis::y;
    const EdgeProjection below = project_edges(geometry, view, z, 0, axis),
                         above = project_edges(geometry, view, z, view.subslices - 1, axis);
    return {{below.offset[0], above.offset[1]}, {below.slope[0], above.slope[1]}, 0};
}

// Whether row y of `first` and row y + apart of `second` share no pixel, for all y: the gap between them is concave in
// y, so it is least at an end.
bool disjoint(const EdgeProjection& first, const EdgeProjection& second, int apart, int ny) {
    for (int y : {0, ny - 1 - apart}) {
        double end = -1e300, begin = 1e300;
        for (int i = 0; i < 2; i++) {
            end = std::max(end, first.offset[i] + first.slope[i] * (y + 1));
            begin = std::min(begin, second.offset[i] + second.slope[i] * (y + apart));
        }
        if (begin - end < 1) return false;
    }
    return true;
}

int rows_apart(const ScanGeometry& geometry, const View& view, int z) {
    const int ny = geometry.grid.ny;
    int apart = 1;
    if (view.orientation == PanelOrientation::rotated) {
        std::vector<RowEdges> columns;
        for (int s = 0; s < products(view); s++) columns.push_back(row_edges(geometry, view, z, s));
        return rotated_independent_step(columns, ny, view.na);
    }
    const EdgeProjection at = faces(geometry, view, z);
    while (apart < ny && !disjoint(at, at, apart, ny)) apart++;
    return apart;
}

// Whether blocks with one between them share no pixel in the slices of a slab.
bool blocks_disjoint(const ScanGeometry& geometry, const Slab& slab) {
    const int ny = geometry.grid.ny, apart = lanes * slab.stride + 1;
    if (apart >= ny) return true;
    for (const View& view : geometry.views)
        for (int a = slab.begin; a < slab.end; a++)
            for (int b = slab.begin; b < slab.end; b++)
                if (!disjoint(faces(geometry, view, a), faces(geometry, view, b), apart, ny)) return false;
    return true;
}

int depth(const ScanGeometry& geometry) {
    int64_t size = 0;
    for (const View& view : geometry.views) {
        if (view.orientation != PanelOrientation::parallel) return 1;
        size += int64_t(products(view)) * products(view) * geometry.grid.nx;
    }
    return int(std::min<int64_t>(most_slices, std::max<int64_t>(1, most_weights / size)));
}

std::vector<int> strides(const ScanGeometry& geometry) {
    const int nz = geometry.grid.nz;
    std::vector<int> stride(nz, 2); // the prior binds neighbouring rows
    parallel(nz, [&](int64_t begin, int64_t end, int) {
        SparseFootprints lists(geometry);
        for (int z = int(begin); z < end; z++) {
            for (const View& view : geometry.views)
                if (ViewLayout(view).separable) stride[z] = std::max(stride[z], rows_apart(geometry, view, z));
            for (size_t i = 0; i < lists.size(); i++) stride[z] = std::max(stride[z], lists.independent_step(i, z));
        }
    });
    return stride;
}

} // namespace

std::vector<Slab> slabs(const ScanGeometry& geometry) {
    const std::vector<int> stride = strides(geometry);
    const int nz = geometry.grid.nz, most = depth(geometry);
    std::vector<Slab> out;
    for (int z = 0; z < nz; z = out.back().end) {
        Slab slab{z, z + 1, stride[z]};
        while (slab.end < nz && slab.end - slab.begin < most) {
            const Slab longer{z, slab.end + 1, std::max(slab.stride, stride[slab.end])};
            if (!blocks_disjoint(geometry, longer)) break;
            slab = longer;
        }
        out.push_back(slab);
    }
    return out;
}

} // namespace palpate
