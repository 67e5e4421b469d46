#include "cutting/cut_skin.h"
#include "linalg/small_dense.h"
#include <algorithm>

namespace palpate {
namespace {

bool on_surface(const SlitParts& parts, int face) { return parts.beyond[face] < 0 || parts.passed[face]; }

// The weights of a point of the complex in a tetrahedron of the mesh: by the edges that it came from, exactly 0 where
// they do not count; beyond the tetrahedron, where a crumb has no element, by its geometry.
void add_weights(const SlitComplex& slit, int point, const double* nodes, const int32_t* corner,
                 std::vector<double>& weight) {
    const SlitComplex::Support& between = slit.support[point];
    double w[4] = {};
    int found = 0;
    for (int k = 0; k < 4; k++)
        for (int s = 0; s < between.count; s++)
            if (corner[k] == between.node[s]) w[k] += between.weight[s], found++;
    if (found < between.count) {
        const double* first = nodes + 3 * size_t(corner[0]);
        double sides[9], *away = w + 1;
        int pivot[3];
        for (int d = 0; d < 3; d++) {
            for (int k = 0; k < 3; k++) sides[3 * d + k] = nodes[3 * size_t(corner[k + 1]) + d] - first[d];
            away[d] = slit.place[3 * size_t(point) + d] - first[d];
        }
        factor(sides, pivot, 3);
        solve_factored(sides, pivot, 3, away);
        w[0] = 1 - w[1] - w[2] - w[3];
    }
    weight.insert(weight.end(), w, w + 4);
}

} // namespace

CutSkin cut_skin(const SlitParts& parts, const VirtualNodes& made, const double* nodes, const int32_t* tets) {
    const std::vector<int> vertex = parts.vertices();
    CutSkin out;
    std::vector<int> number(vertex.size(), -1); // of each vertex on the surface
    for (int face = 0; face < int(parts.beyond.size()); face++) {
        if (!on_surface(parts, face)) continue;
        std::array<int, 3> triangle;
        for (int k = 0; k < 3; k++) {
            triangle[k] = vertex[4 * size_t(face / 4) + tet_face[face % 4][k]];
            number[triangle[k]] = 0;
        }
        out.triangle.push_back(triangle);
        out.lip.push_back(parts.passed[face]);
    }
    int count = 0;
    for (int& n : number)
        if (n == 0) n = count++;
    for (auto& triangle : out.triangle)
        for (int& v : triangle) v = number[v];

    std::vector<int> place(count, -1); // a corner of a part at each vertex, if there is one in a fragment with its own
    std::vector<uint8_t> own(count);   // element
    for (int c = 0; c < int(vertex.size()); c++) {
        const int v = number[vertex[c]], f = parts.fragment[c / 4];
        if (v < 0 || own[v]) continue;
        own[v] = made.parent[made.element[f]] == parts.owner[f];
        if (own[v] || place[v] < 0) place[v] = c;
    }
    for (int c : place) {
        const int tet = made.element[parts.fragment[c / 4]];
        out.tet.push_back(tet);
        add_weights(parts.slit, parts.slit.corner[c / 4][c % 4], nodes, tets + 4 * size_t(made.parent[tet]),
                    out.weight);
    }
    return out;
}

std::vector<std::array<int, 2>> pinched_edges(const SlitParts& parts) {
    const std::vector<int> vertex = parts.vertices();
    std::vector<std::array<int, 4>> edges; // from vertex, to vertex, and the corners of parts that these are
    for (int face = 0; face < int(parts.beyond.size()); face++) {
        if (!on_surface(parts, face)) continue;
        for (int k = 0; k < 3; k++) {
            const int a = face / 4 * 4 + tet_face[face % 4][k], b = face / 4 * 4 + tet_face[face % 4][(k + 1) % 3];
            edges.push_back({vertex[a], vertex[b], a, b});
        }
    }
    std::sort(edges.begin(), edges.end());
    const auto point = [&](int corner) { return parts.slit.corner[corner / 4][corner % 4]; };
    std::vector<std::array<int, 2>> out;
    for (size_t k = 1; k < edges.size(); k++)
        if (edges[k][0] == edges[k - 1][0] && edges[k][1] == edges[k - 1][1]) {
            const auto [low, high] = std::minmax({point(edges[k][2]), point(edges[k][3])});
            out.push_back({low, high});
        }
    std::sort(out.begin(), out.end());
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
}

DrawnSkin drawn_skin(const std::vector<std::array<int, 3>>& triangle, const std::vector<uint8_t>& lip,
                     const std::vector<int>& rank, int ranks) {
    const int count = int(rank.size());
    const auto layer = [&](size_t t, int v) { return lip[t] ? 1 + rank[v] : 0; };
    std::vector<int> number(size_t(count) * (1 + ranks), -1); // by layer, then vertex
    for (size_t t = 0; t < triangle.size(); t++)
        for (int v : triangle[t]) number[size_t(count) * layer(t, v) + v] = 0;
    DrawnSkin out;
    for (size_t k = 0; k < number.size(); k++) {
        if (k >= size_t(count) && k % count == 0) out.lips.push_back(int(out.vertex.size()));
        if (number[k] < 0) continue;
        number[k] = int(out.vertex.size());
        out.vertex.push_back(int(k % count));
    }
    for (size_t t = 0; t < triangle.size(); t++) {
        out.triangle.push_back(triangle[t]);
        for (int& v : out.triangle.back()) v = number[size_t(count) * layer(t, v) + v];
    }
    return out;
}

} // namespace palpate
