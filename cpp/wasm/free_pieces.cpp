#include "wasm/free_pieces.h"
#include "base/vec3.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr double on_a_line = 1e-6; // of the held nodes' extent

Point3 less(const double* a, const double* b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

Point3 cross(const Point3& u, const Point3& w) {
    return {u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]};
}

// Whether these points (mm) are not all on one line: held, they leave no rigid motion.
bool hold_still(const std::vector<Point3>& points) {
    const auto furthest = [&](const auto& size) {
        double most = 0;
        Point3 found{0, 0, 0};
        for (const Point3& x : points) {
            const double d[3] = {x[0] - points[0][0], x[1] - points[0][1], x[2] - points[0][2]};
            if (size(d) > most) most = size(d), found = {d[0], d[1], d[2]};
        }
        return std::pair(most, found);
    };
    if (points.empty()) return false;
    const auto [long_side, axis] = furthest([](const double* d) { return length(d); });
    const auto off_axis = [&, size = long_side, along = axis](const double* d) {
        const double part = dot(d, along.data()) / (size * size);
        const double off[3] = {d[0] - part * along[0], d[1] - part * along[1], d[2] - part * along[2]};
        return length(off);
    };
    return long_side > 0 && furthest(off_axis).first > on_a_line * long_side;
}

double volume_of(const OrganSolid& solid, int t) {
    const double* x[4];
    for (int k = 0; k < 4; k++) x[k] = &solid.node[3 * size_t(solid.tet[4 * size_t(t) + k])];
    return dot(cross(less(x[1], x[0]), less(x[2], x[0])).data(), less(x[3], x[0]).data()) / 6;
}

} // namespace

std::vector<uint8_t> free_pieces(const VirtualNodes& mesh, const OrganSolid& solid) {
    std::vector<std::vector<Point3>> held(*std::max_element(mesh.body.begin(), mesh.body.end()) + 1);
    for (size_t t = 0; t < mesh.tet.size(); t++)
        for (int i : mesh.tet[t]) {
            const double* x = &solid.node[3 * size_t(mesh.origin[i])];
            if (solid.fixed[mesh.origin[i]]) held[mesh.body[t]].push_back({x[0], x[1], x[2]});
        }
    std::vector<uint8_t> out;
    for (const auto& points : held) out.push_back(!hold_still(points));
    return out;
}

std::vector<double> volumes_of(const VirtualNodes& mesh, const std::vector<uint8_t>& pieces, const OrganSolid& solid) {
    std::vector<double> out(solid.regions.size());
    for (size_t t = 0; t < mesh.tet.size(); t++)
        if (pieces[mesh.body[t]])
            out[rank_of(solid, mesh.parent[t])] += mesh.share[t] * volume_of(solid, mesh.parent[t]);
    return out;
}

double cut_area(const CutBody& cut, const OrganSolid& solid) {
    std::vector<Point3> place(cut.skin.tet.size());
    for (size_t v = 0; v < place.size(); v++)
        for (int k = 0; k < 4; k++) {
            const double* x = &solid.node[3 * size_t(cut.mesh.origin[cut.mesh.tet[cut.skin.tet[v]][k]])];
            for (int d = 0; d < 3; d++) place[v][d] += cut.skin.weight[4 * v + k] * x[d];
        }
    double area = 0;
    for (size_t t = 0; t < cut.skin.triangle.size(); t++) {
        if (!cut.skin.lip[t]) continue;
        const auto [a, b, c] = cut.skin.triangle[t];
        const Point3 n = cross(less(place[b].data(), place[a].data()), less(place[c].data(), place[a].data()));
        area += length(n.data()) / 4; // half of a triangle, of one of the two lips
    }
    return area;
}

int rank_of(const OrganSolid& solid, int tet) {
    return int(std::find(solid.regions.begin(), solid.regions.end(), solid.region[tet]) - solid.regions.begin());
}

} // namespace palpate
