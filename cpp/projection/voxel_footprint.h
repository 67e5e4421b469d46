// Columns of the system matrix A, voxel by voxel. Called by the coordinate descent's sparse footprints and by tests.
#pragma once
#include "projection/footprint_weights.h"

namespace palpate {

// The pixels that a voxel touches in each view, and their weights. prepare(z) makes the 1-D weights of a slice;
// visits after it only read, so that threads may share it.
class VoxelFootprint {
    const ScanGeometry& geometry;
    struct Sub {
        AxisWeights x, y; // y unused on a rotated panel
        RowEdges edges;   // used on a rotated panel only
    };
    std::vector<std::vector<Sub>> views; // per view, per product

public:
    explicit VoxelFootprint(const ScanGeometry& geometry) : geometry(geometry), views(geometry.views.size()) {
        for (size_t k = 0; k < views.size(); k++) views[k].resize(products(geometry.views[k]));
    }

    void prepare(int z) {
        for (size_t k = 0; k < views.size(); k++) {
            const View& v = geometry.views[k];
            for (int s = 0; s < products(v); s++) {
                Sub& sub = views[k][s];
                voxel_weights(geometry, v, z, s, Axis::x, sub.x);
                if (v.orientation == PanelOrientation::rotated)
                    sub.edges = row_edges(geometry, v, z, s);
                else
                    voxel_weights(geometry, v, z, s, Axis::y, sub.y);
            }
        }
    }

    // Calls visit(measured pixel, weight in mm) for the pixels of view k that voxel (y, x) of the prepared slice
    // touches. A pixel may come more than once (sub-slices, resampling): its weights add up.
    template <class Visit> void visit(int k, int y, int x, Visit visit) const {
        const View& v = geometry.views[k];
        if (v.swapped) std::swap(y, x);
        for (const Sub& sub : views[k])
            for (int i = 0; i < sub.x.taps; i++) {
                const float wx = sub.x.weight[size_t(i) * sub.x.n + x];
                const int a = sub.x.first[x] + i;
                if (wx == 0) continue;
                if (v.orientation == PanelOrientation::rotated)
                    along_column(v, sub.edges, y, a, wx, visit);
                else
                    for (int j = 0; j < sub.y.taps; j++) {
                        const float w = wx * sub.y.weight[size_t(j) * sub.y.n + y];
                        if (w != 0) reach(v, sub.y.first[y] + j, a, w, visit);
                    }
            }
    }

private:
    template <class Visit>
    static void along_column(const View& v, const RowEdges& edges, int y, int a, float wx, Visit& visit) {
        const double low = std::max(edges.at(y, a), 0.0), high = std::min(edges.at(y + 1, a), double(v.nb));
        for (int b = int(low); b < high; b++) {
            const float w = wx * float(std::min(high, b + 1.0) - std::max(low, double(b)));
            if (w != 0) reach(v, b, a, w, visit);
        }
    }

    template <class Visit> static void reach(const View& v, int b, int a, float w, Visit& visit) {
        if (v.orientation != PanelOrientation::oblique) {
            const int64_t pixel = v.start + b * v.step_b + a * v.step_a;
            visit(pixel, w * v.path(pixel));
            return;
        }
        const SparseRows& fine = v.resampling.fine;
        for (int64_t e = fine.offset[int64_t(b) * v.na + a]; e < fine.offset[int64_t(b) * v.na + a + 1]; e++)
            visit(int64_t(fine.index[e]), w * fine.weight[e] * v.path(fine.index[e]));
    }
};

} // namespace palpate
