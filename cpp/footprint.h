#pragma once
#include "weights.h"

namespace palpate {

// Columns of A, voxel by voxel: which pixels of a view a voxel touches, and how much. prepare(z) makes the 1-D weights
// of a slice in all views; visits after it are read-only, so threads may share it.
class Footprints {
    const Geometry& geometry;
    struct Sub {
        AxisWeights x, y; // y unused on a turned panel
        Edges edges;      // used on a turned panel only
    };
    std::vector<std::vector<Sub>> views; // per view, per product

public:
    explicit Footprints(const Geometry& geometry) : geometry(geometry), views(geometry.views.size()) {
        for (size_t k = 0; k < views.size(); k++) views[k].resize(products(geometry.views[k]));
    }

    void prepare(int z) {
        for (size_t k = 0; k < views.size(); k++) {
            const View& v = geometry.views[k];
            for (int s = 0; s < products(v); s++) {
                Sub& sub = views[k][s];
                by_voxel(geometry, v, z, s, Axis::x, sub.x);
                if (v.pose == Pose::turned)
                    sub.edges = edges(geometry, v, z, s);
                else
                    by_voxel(geometry, v, z, s, Axis::y, sub.y);
            }
        }
    }

    // Calls visit(measured pixel, weight in mm) for what voxel (y, x) of the prepared slice touches in view k. A pixel
    // may come more than once (sub-slices, resampling): the weights add up.
    template <class Visit> void visit(int k, int y, int x, Visit visit) const {
        const View& v = geometry.views[k];
        if (v.swapped) std::swap(y, x);
        for (const Sub& sub : views[k])
            for (int i = 0; i < sub.x.taps; i++) {
                const float wx = sub.x.weight[size_t(i) * sub.x.n + x];
                const int a = sub.x.first[x] + i;
                if (wx == 0) continue;
                if (v.pose == Pose::turned)
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
    static void along_column(const View& v, const Edges& edges, int y, int a, float wx, Visit& visit) {
        const double low = std::max(edges.at(y, a), 0.0), high = std::min(edges.at(y + 1, a), double(v.nb));
        for (int b = int(low); b < high; b++) {
            const float w = wx * float(std::min(high, b + 1.0) - std::max(low, double(b)));
            if (w != 0) reach(v, b, a, w, visit);
        }
    }

    template <class Visit> static void reach(const View& v, int b, int a, float w, Visit& visit) {
        if (v.pose != Pose::tilted) {
            const int64_t pixel = v.start + b * v.step_b + a * v.step_a;
            visit(pixel, w * v.path(pixel));
            return;
        }
        const Sparse& fine = v.resampling.fine;
        for (int64_t e = fine.offset[int64_t(b) * v.na + a]; e < fine.offset[int64_t(b) * v.na + a + 1]; e++)
            visit(int64_t(fine.index[e]), w * fine.weight[e] * v.path(fine.index[e]));
    }
};

} // namespace palpate
