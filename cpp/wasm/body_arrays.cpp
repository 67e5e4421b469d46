#include "wasm/body_arrays.h"
#include "base/vec3.h"
#include "elements/smoothed_stiffness.h"
#include "wasm/lip_contact.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr double one_place = 1e-8; // of the body's extent, as in palpate.tissue.lip_gaps

// lips: of a cut body, which press on each other where they meet.
Made factor(const ElasticSolid& solid, const LipGaps& lips, BodyArrays& body) {
    const std::vector<int> free_index = numbered_free(body.fixed);
    std::vector<double> places;
    for (int i = 0; i < solid.nodes; i++)
        if (free_index[i] >= 0) places.insert(places.end(), solid.node + 3 * size_t(i), solid.node + 3 * size_t(i) + 3);
    const SparseCholesky factor(smoothed_stiffness(solid, free_index), places.data());
    if (!factor.positive) return not_positive_definite;
    std::vector<int> vertices;
    for (int i : body.shown)
        if (free_index[i] >= 0) vertices.push_back(free_index[i]);
    bool too_many = false;
    body.gaps = lip_contact(lips, factor, free_index, vertices, too_many);
    if (too_many) return too_many_gaps;
    body.tree = factor.tree;
    body.factor = factor.rounded(); // which ticks and tables take
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
LipGaps make_surfaces(const CutBody& cut, const OrganSolid& solid, BodyArrays& body) {
    const VirtualNodes& mesh = cut.mesh;
    const CutSkin& skin = cut.skin;
    const size_t vertices = skin.tet.size();
    body.place.assign(3 * vertices, 0);
    body.held.assign(vertices, 1);
    body.weight = skin.weight;
    std::vector<int> rank;
    for (size_t v = 0; v < vertices; v++) {
        const auto& tet = mesh.tet[skin.tet[v]];
        body.carrier.insert(body.carrier.end(), tet.begin(), tet.end());
        for (int k = 0; k < 4; k++) {
            const double w = skin.weight[4 * v + k];
            if (w != 0) body.shown.push_back(tet[k]);
            if (w != 0 && !body.fixed[tet[k]]) body.held[v] = 0;
            for (int d = 0; d < 3; d++) body.place[3 * v + d] += w * body.node[3 * size_t(tet[k]) + d];
        }
        rank.push_back(rank_of(solid, mesh.parent[skin.tet[v]]));
    }
    std::sort(body.shown.begin(), body.shown.end());
    body.shown.erase(std::unique(body.shown.begin(), body.shown.end()), body.shown.end());
    for (const auto& corners : skin.triangle) body.triangle.insert(body.triangle.end(), corners.begin(), corners.end());

    body.drawn = drawn_skin(skin.triangle, skin.lip, rank, int(solid.regions.size()));
    for (int v : body.drawn.vertex)
        for (int k = 0; k < 4; k++) {
            const auto at = std::lower_bound(body.shown.begin(), body.shown.end(), body.carrier[4 * size_t(v) + k]);
            // A node that is not shown counts for nothing there.
            body.drawn_by.push_back(std::min(int(at - body.shown.begin()), int(body.shown.size()) - 1));
            body.drawn_as.push_back(float(skin.weight[4 * size_t(v) + k]));
        }
    for (int v : body.drawn.vertex)
        for (int d = 0; d < 3; d++) body.rest.push_back(float(body.place[3 * size_t(v) + d]));
    return lip_gaps({int(vertices), int(skin.triangle.size()), body.triangle.data(), skin.lip.data(),
                     body.carrier.data(), skin.weight.data(), body.place.data(), mesh.origin.data()},
                    one_place * mesh_extent(body.node.data(), int(body.fixed.size())));
}

template <class Vector> AnyArray any(Vector& of) {
    constexpr size_t one = sizeof(typename Vector::value_type);
    return {of.data(), of.size() * one, &of, [](void* vector, size_t bytes) -> void* {
                auto& it = *static_cast<Vector*>(vector);
                it.resize(bytes / one);
                return it.data();
            }};
}

Made make_whole_body(const OrganSolid& solid, BodyArrays& body) {
    body.node = body.place = solid.node;
    body.fixed = body.held = solid.fixed;
    body.triangle = solid.triangle;
    body.shown = solid.shown;
    return factor({solid.node.data(), solid.tet.data(), solid.region.data(), solid.lam.data(), solid.mu.data(),
                   solid.nodes(), solid.tets()},
                  {{0}, {}, {}, {}}, body);
}

} // namespace

std::vector<int> numbered_free(const std::vector<uint8_t>& fixed) {
    std::vector<int> out(fixed.size(), -1);
    for (size_t i = 0, next = 0; i < fixed.size(); i++)
        if (!fixed[i]) out[i] = int(next++);
    return out;
}

std::vector<AnyArray> arrays_of(BodyArrays& body) {
    Supernodes& t = body.tree;
    GapConstraints& g = body.gaps;
    DrawnSkin& d = body.drawn;
    return {any(body.factor),   any(t.order),       any(t.place),       any(t.first),   any(t.part),
            any(t.parent),      any(t.row_start),   any(t.row),         any(t.index),   any(t.index_start),
            any(t.entry_start), any(g.rest),        any(g.give),        any(g.between), any(g.response),
            any(g.first),       any(g.node),        any(g.share),       any(body.node), any(body.fixed),
            any(body.shown),    any(body.place),    any(body.triangle), any(body.held), any(body.carrier),
            any(body.weight),   any(d.vertex),      any(d.triangle),    any(d.lips),    any(body.rest),
            any(body.drawn_by), any(body.drawn_as), any(body.area),     any(body.taken)};
}

Made make_body(const OrganSolid& solid, const Cuts& cuts, BodyArrays& body) {
    body = {};
    if (cuts.empty()) return make_whole_body(solid, body);
    CutBody cut = cut_body(solid.node.data(), solid.nodes(), solid.tet.data(), solid.tets(), solid.fixed.data(), cuts);
    const VirtualNodes& mesh = cut.mesh;
    if (std::count(cut.gone.begin(), cut.gone.end(), 0) == 0) return comes_free;
    body.area = cut.cut_area;
    body.taken.resize(solid.regions.size());
    for (size_t t = 0; t < mesh.tet.size(); t++)
        if (cut.gone[t]) body.taken[rank_of(solid, mesh.parent[t])] += mesh.share[t] * volume_of(solid, mesh.parent[t]);
    take_away(cut);
    for (int i : mesh.origin)
        body.node.insert(body.node.end(), &solid.node[3 * size_t(i)], &solid.node[3 * size_t(i)] + 3);
    body.fixed = picked(solid.fixed, mesh.origin);
    for (size_t i = 0; i < body.fixed.size(); i++)
        body.fixed[i] &= mesh.real[i]; // what lies beyond the blade holds nothing
    const std::vector<int32_t> region = picked(solid.region, mesh.parent);
    const std::vector<double> lam = picked(solid.lam, mesh.parent), mu = picked(solid.mu, mesh.parent);
    const LipGaps lips = make_surfaces(cut, solid, body);
    return factor({body.node.data(), mesh.tet[0].data(), region.data(), lam.data(), mu.data(), int(mesh.origin.size()),
                   int(mesh.tet.size()), mesh.share.data()},
                  lips, body);
}

} // namespace palpate
