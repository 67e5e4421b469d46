#include "cutting/cut_body.h"
#include "cutting/free_pieces.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr int most_rounds = 40;    // of splitting edges where the surface touches itself; two or three are enough
constexpr double on_blade = 1e-11; // of the mesh's extent: what lies so near to a blade lies on it

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

namespace {

CutBody made_of(const SlitParts& parts, const double* nodes, const int32_t* tets) {
    CutBody out{virtual_nodes(parts, tets), {}, {}, {}, {}};
    out.skin = cut_skin(parts, out.mesh, nodes, tets);
    out.gone.resize(out.mesh.tet.size());
    for (size_t f = 0; f < parts.fragment_of.size(); f++)
        if (parts.slit.gone[parts.fragment_of[f]]) out.gone[out.mesh.element[f]] = 1;
    for (int face = 0; face < int(parts.passed.size()); face++) {
        if (!parts.passed[face] || parts.beyond[face] < face / 4) continue;
        out.cut_parent.push_back(parts.slit.parent[face / 4]);
        out.cut_area.push_back(parts.area(face));
    }
    return out;
}

} // namespace

CutBody cut_body(const double* nodes, int node_count, const int32_t* tets, int tet_count, const uint8_t* held,
                 const std::vector<std::vector<BladeTriangle>>& cuts) {
    SlitComplex slit(nodes, node_count, tets, tet_count, on_blade * mesh_extent(nodes, node_count));
    for (const auto& blade : cuts) {
        slit.slit(blade);
        if (held) take_free_pieces(slit, SlitParts(slit), held, node_count);
    }
    for (int round = 0;; round++) {
        const SlitParts parts(slit);
        const auto pinched = pinched_edges(parts);
        if (pinched.empty() || round == most_rounds) return made_of(parts, nodes, tets);
        for (const auto& [a, b] : pinched) slit.split(a, b, 0.5);
    }
}

void take_away(CutBody& body) {
    VirtualNodes& mesh = body.mesh;
    CutSkin& skin = body.skin;
    const auto stays = [&](int tet) { return !body.gone[tet]; };
    std::vector<int> tet_number(mesh.tet.size(), -1), node_number(mesh.origin.size(), -1),
        vertex_number(skin.tet.size(), -1);
    for (size_t t = 0, next = 0; t < mesh.tet.size(); t++)
        if (stays(int(t))) {
            tet_number[t] = int(next++);
            for (int node : mesh.tet[t]) node_number[node] = 0;
        }
    VirtualNodes left;
    for (size_t i = 0; i < node_number.size(); i++)
        if (node_number[i] == 0)
            node_number[i] = int(left.origin.size()), left.origin.push_back(mesh.origin[i]),
            left.real.push_back(mesh.real[i]);
    for (size_t t = 0; t < mesh.tet.size(); t++) {
        if (tet_number[t] < 0) continue;
        left.tet.push_back(mesh.tet[t]);
        for (int& node : left.tet.back()) node = node_number[node];
        left.parent.push_back(mesh.parent[t]), left.share.push_back(mesh.share[t]);
        left.side.push_back(mesh.side[t]), left.body.push_back(mesh.body[t]);
    }
    CutSkin drawn;
    for (size_t v = 0; v < skin.tet.size(); v++) {
        if (tet_number[skin.tet[v]] < 0) continue;
        vertex_number[v] = int(drawn.tet.size());
        drawn.tet.push_back(tet_number[skin.tet[v]]);
        drawn.weight.insert(drawn.weight.end(), &skin.weight[4 * v], &skin.weight[4 * v] + 4);
    }
    for (size_t t = 0; t < skin.triangle.size(); t++) {
        if (vertex_number[skin.triangle[t][0]] < 0) continue;
        drawn.triangle.push_back(skin.triangle[t]);
        for (int& v : drawn.triangle.back()) v = vertex_number[v];
        drawn.lip.push_back(skin.lip[t]);
    }
    mesh = std::move(left), skin = std::move(drawn);
    body.gone.assign(mesh.tet.size(), 0);
}

} // namespace palpate
