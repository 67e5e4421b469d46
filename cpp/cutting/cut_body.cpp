#include "cutting/cut_body.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr double on_blade = 1e-9; // of the mesh's extent: what lies so near to a blade lies on it

} // namespace

double mesh_extent(const double* nodes, int count) {
    double low[3] = {nodes[0], nodes[1], nodes[2]}, high[3] = {nodes[0], nodes[1], nodes[2]}, most = 0;
    for (int i = 0; i < count; i++)
        for (int d = 0; d < 3; d++) {
            low[d] = std::min(low[d], nodes[3 * size_t(i) + d]);
            high[d] = std::max(high[d], nodes[3 * size_t(i) + d]);
        }
    for (int d = 0; d < 3; d++) most = std::max(most, high[d] - low[d]);
    return most;
}

CutBody cut_body(const double* nodes, int node_count, const int32_t* tets, int tet_count,
                 const std::vector<BladeTriangle>& blade) {
    SlitComplex slit(nodes, node_count, tets, tet_count, on_blade * mesh_extent(nodes, node_count));
    slit.slit(blade);
    while (true) {
        const SlitParts parts(slit);
        const auto pinched = pinched_edges(parts);
        if (pinched.empty()) {
            CutBody out{virtual_nodes(parts, tets), {}};
            out.skin = cut_skin(parts, out.mesh, nodes, tets);
            return out;
        }
        for (const auto& [a, b] : pinched) slit.split(a, b, 0.5);
    }
}

} // namespace palpate
