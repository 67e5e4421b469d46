#include "wasm/organ_body.h"
#include "base/vec3.h"
#include "elements/smoothed_stiffness.h"
#include "wasm/lip_contact.h"
#include <algorithm>
#include <numeric>

namespace palpate {
namespace {

constexpr size_t table_bytes = size_t(256) << 20; // of the compliance's tables, as in Python
constexpr double one_place = 1e-8;                // of the body's extent, as in palpate.tissue.lip_gaps

std::vector<int> numbered_free(const std::vector<uint8_t>& fixed) {
    std::vector<int> out(fixed.size(), -1);
    for (size_t i = 0, next = 0; i < fixed.size(); i++)
        if (!fixed[i]) out[i] = int(next++);
    return out;
}

// lips: of a cut body, which press on each other where they meet.
Made make_model(OrganBody& body, const ElasticSolid& solid, const std::vector<uint8_t>& fixed, const LipGaps& lips) {
    const std::vector<int> free_index = numbered_free(fixed);
    std::vector<double> places;
    for (int i = 0; i < solid.nodes; i++)
        if (free_index[i] >= 0) places.insert(places.end(), solid.node + 3 * size_t(i), solid.node + 3 * size_t(i) + 3);
    body.factor = std::make_unique<SparseCholesky>(smoothed_stiffness(solid, free_index), places.data());
    if (!body.factor->positive) return not_positive_definite;
    std::vector<int> vertices, free_vertices;
    for (int i : body.shown)
        if (free_index[i] >= 0) vertices.push_back(i), free_vertices.push_back(free_index[i]);
    bool too_many = false;
    GapConstraints gaps = lip_contact(lips, *body.factor, free_index, free_vertices, too_many);
    if (too_many) return too_many_gaps;
    FactoredStiffness stiffness = factored_stiffness(*body.factor, free_index, vertices, solid.node);
    body.model = gaps.count > 0 ? std::make_unique<ComplianceModel>(std::move(stiffness), table_bytes, std::move(gaps))
                                : std::make_unique<ComplianceModel>(std::move(stiffness), table_bytes);
    body.factor->value = {}; // ticks and tables take the rounded one
    return made;
}

// The place in `regions` of a tetrahedron's region.
int rank_of(const OrganSolid& solid, int tet) {
    return int(std::find(solid.regions.begin(), solid.regions.end(), solid.region[tet]) - solid.regions.begin());
}

// mm^3.
double volume_of(const OrganSolid& solid, int tet) {
    double side[3][3];
    const auto at = [&](int k) { return &solid.node[3 * size_t(solid.tet[4 * size_t(tet) + k])]; };
    for (int k = 0; k < 3; k++)
        for (int d = 0; d < 3; d++) side[k][d] = at(k + 1)[d] - at(0)[d];
    const auto& [a, b, c] = side;
    const double n[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    return dot(n, c) / 6;
}

template <class T> std::vector<T> picked(const std::vector<T>& from, const std::vector<int>& at) {
    std::vector<T> out;
    for (int i : at) out.push_back(from[i]);
    return out;
}

// The surface that tools touch, and what is drawn. Returns the gaps between its lips.
LipGaps make_surfaces(OrganBody& body, const OrganSolid& solid, const std::vector<double>& node,
                      const std::vector<uint8_t>& fixed) {
    const VirtualNodes& mesh = body.cut.mesh;
    const CutSkin& skin = body.cut.skin;
    const size_t vertices = skin.tet.size();
    std::vector<double> place(3 * vertices);
    std::vector<uint8_t> held(vertices, 1);
    std::vector<int32_t> carrier;
    std::vector<int> rank;
    for (size_t v = 0; v < vertices; v++) {
        const auto& tet = mesh.tet[skin.tet[v]];
        carrier.insert(carrier.end(), tet.begin(), tet.end());
        for (int k = 0; k < 4; k++) {
            const double w = skin.weight[4 * v + k];
            if (w != 0) body.shown.push_back(tet[k]);
            if (w != 0 && !fixed[tet[k]]) held[v] = 0;
            for (int d = 0; d < 3; d++) place[3 * v + d] += w * node[3 * size_t(tet[k]) + d];
        }
        rank.push_back(rank_of(solid, mesh.parent[skin.tet[v]]));
    }
    std::sort(body.shown.begin(), body.shown.end());
    body.shown.erase(std::unique(body.shown.begin(), body.shown.end()), body.shown.end());
    body.surface = std::make_unique<ContactSurface>(place.data(), int(vertices), skin.triangle[0].data(),
                                                    int(skin.triangle.size()), held.data());
    body.surface->carry(carrier.data(), skin.weight.data(), int(vertices), fixed.data(), int(fixed.size()));

    body.drawn = drawn_skin(skin.triangle, skin.lip, rank, int(solid.regions.size()));
    for (int v : body.drawn.vertex)
        for (int k = 0; k < 4; k++) {
            const auto at = std::lower_bound(body.shown.begin(), body.shown.end(), carrier[4 * size_t(v) + k]);
            // A node that is not shown counts for nothing there.
            body.carrier.push_back(std::min(int(at - body.shown.begin()), int(body.shown.size()) - 1));
            body.carrying.push_back(float(skin.weight[4 * size_t(v) + k]));
        }
    for (int v : body.drawn.vertex)
        for (int d = 0; d < 3; d++) body.rest.push_back(float(place[3 * size_t(v) + d]));
    return lip_gaps({int(vertices), int(skin.triangle.size()), skin.triangle[0].data(), skin.lip.data(), carrier.data(),
                     skin.weight.data(), place.data(), mesh.origin.data()},
                    one_place * mesh_extent(node.data(), int(fixed.size())));
}

} // namespace

const float* OrganBody::carried(const std::vector<float>& of_nodes, std::vector<float>& out) const {
    if (!was_cut()) return of_nodes.data();
    out.assign(3 * drawn.vertex.size(), 0);
    for (size_t k = 0; k < carrier.size(); k++)
        for (int d = 0; d < 3; d++) out[3 * (k / 4) + d] += carrying[k] * of_nodes[3 * size_t(carrier[k]) + d];
    return out.data();
}

OrganBody whole_body(const OrganSolid& solid) {
    OrganBody body;
    body.shown = solid.shown;
    make_model(body,
               {solid.node.data(), solid.tet.data(), solid.region.data(), solid.lam.data(), solid.mu.data(),
                solid.nodes(), solid.tets()},
               solid.fixed, {{0}, {}, {}, {}});
    body.surface = std::make_unique<ContactSurface>(solid.node.data(), solid.nodes(), solid.triangle.data(),
                                                    int(solid.triangle.size() / 3), solid.fixed.data());
    return body;
}

OrganBody cut_body_of(const OrganSolid& solid, const std::vector<std::vector<BladeTriangle>>& cuts, Made& answer) {
    OrganBody body;
    body.cut = cut_body(solid.node.data(), solid.nodes(), solid.tet.data(), solid.tets(), solid.fixed.data(), cuts);
    const VirtualNodes& mesh = body.cut.mesh;
    answer = comes_free;
    if (std::count(body.cut.gone.begin(), body.cut.gone.end(), 0) == 0) return body;
    body.area = std::accumulate(body.cut.cut_area.begin(), body.cut.cut_area.end(), 0.0);
    body.taken.resize(solid.regions.size());
    for (size_t t = 0; t < mesh.tet.size(); t++)
        if (body.cut.gone[t])
            body.taken[rank_of(solid, mesh.parent[t])] += mesh.share[t] * volume_of(solid, mesh.parent[t]);
    take_away(body.cut);
    std::vector<double> node;
    for (int i : mesh.origin) node.insert(node.end(), &solid.node[3 * size_t(i)], &solid.node[3 * size_t(i)] + 3);
    std::vector<uint8_t> fixed = picked(solid.fixed, mesh.origin);
    for (size_t i = 0; i < fixed.size(); i++) fixed[i] &= mesh.real[i]; // what lies beyond the blade holds nothing
    const std::vector<int32_t> region = picked(solid.region, mesh.parent);
    const std::vector<double> lam = picked(solid.lam, mesh.parent), mu = picked(solid.mu, mesh.parent);
    const LipGaps lips = make_surfaces(body, solid, node, fixed);
    answer = make_model(body,
                        {node.data(), mesh.tet[0].data(), region.data(), lam.data(), mu.data(), int(mesh.origin.size()),
                         int(mesh.tet.size()), mesh.share.data()},
                        fixed, lips);
    return body;
}

} // namespace palpate
