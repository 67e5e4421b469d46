#include "cutting/slit_complex.h"
#include <algorithm>
#include <cmath>
#include <iterator>

namespace palpate {
namespace {

constexpr double rounding = 1e-3; // of what counts as on a plane: so near lies what was put there

double dot(const Point3& a, const Point3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

Point3 less(const double* a, const double* b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

Point3 unit_cross(const Point3& a, const Point3& b) {
    Point3 c{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    const double length = std::sqrt(dot(c, c));
    for (double& v : c) v /= length;
    return c;
}

SlitComplex::Face ascending(int a, int b, int c) {
    SlitComplex::Face face{a, b, c};
    std::sort(face.begin(), face.end());
    return face;
}

template <class T> void sort_once(std::vector<T>& values) {
    std::sort(values.begin(), values.end());
    values.erase(std::unique(values.begin(), values.end()), values.end());
}

void insert(std::vector<int>& sorted, int value) {
    const auto at = std::lower_bound(sorted.begin(), sorted.end(), value);
    if (at == sorted.end() || *at != value) sorted.insert(at, value);
}

void erase(std::vector<int>& sorted, int value) {
    const auto at = std::lower_bound(sorted.begin(), sorted.end(), value);
    if (at != sorted.end() && *at == value) sorted.erase(at);
}

std::vector<int> common(const std::vector<int>& a, const std::vector<int>& b) {
    std::vector<int> out;
    std::set_intersection(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(out));
    return out;
}

} // namespace

BladeTriangle::BladeTriangle(const double* a, const double* b, const double* c) {
    const double* from[3] = {a, b, c};
    Point3 along[3];
    for (int k = 0; k < 3; k++) {
        corner[k] = {from[k][0], from[k][1], from[k][2]};
        along[k] = less(from[(k + 1) % 3], from[k]);
    }
    normal = unit_cross(along[0], along[1]);
    for (int k = 0; k < 3; k++) outwards[k] = unit_cross(along[k], normal);
}

double BladeTriangle::height(const double* x) const { return dot(less(x, corner[0].data()), normal); }

double BladeTriangle::beyond(const double* x, int side) const {
    return dot(less(x, corner[side].data()), outwards[side]);
}

bool BladeTriangle::meets(const double* const x[4], double near) const {
    for (int d = 0; d < 3; d++) { // boxes
        const auto [low, high] = std::minmax({x[0][d], x[1][d], x[2][d], x[3][d]});
        const auto [least, most] = std::minmax({corner[0][d], corner[1][d], corner[2][d]});
        if (low > most + near || high < least - near) return false;
    }
    const auto [low, high] = std::minmax({height(x[0]), height(x[1]), height(x[2]), height(x[3])});
    if (low > near || high < -near) return false;
    for (int s = 0; s < 3; s++)
        if (std::min({beyond(x[0], s), beyond(x[1], s), beyond(x[2], s), beyond(x[3], s)}) > near) return false;
    return true;
}

std::vector<BladeTriangle> blade_triangles(const double* points, const int32_t* triangles, int count) {
    std::vector<BladeTriangle> out;
    for (const int32_t* t = triangles; t < triangles + 3 * int64_t(count); t += 3)
        out.emplace_back(points + 3 * size_t(t[0]), points + 3 * size_t(t[1]), points + 3 * size_t(t[2]));
    return out;
}

void SlitComplex::Support::add(int of, double w) {
    const int at = int(std::find(node, node + count, of) - node);
    if (at == count) node[count++] = of; // both ends of an edge lie in one tetrahedron: never a fifth
    weight[at] += w;
}

SlitComplex::SlitComplex(const double* nodes, int node_count, const int32_t* tets, int tet_count, double near)
    : place(nodes, nodes + 3 * size_t(node_count)), support(node_count), corner(tet_count), parent(tet_count),
      gone(tet_count), near(near), pieces(tet_count), around(node_count), active(tet_count) {
    for (int n = 0; n < node_count; n++) support[n].add(n, 1);
    for (int t = 0; t < tet_count; t++) {
        parent[t] = t;
        pieces[t] = {t};
        for (int k = 0; k < 4; k++) {
            corner[t][k] = tets[4 * size_t(t) + k];
            around[corner[t][k]].push_back(t);
        }
    }
    whole = corner;
}

bool SlitComplex::meets(const BladeTriangle& triangle, const std::array<int, 4>& tet) const {
    const double* x[4];
    for (int k = 0; k < 4; k++) x[k] = &place[3 * size_t(tet[k])];
    return triangle.meets(x, near);
}

void SlitComplex::slit(const std::vector<BladeTriangle>& blade) {
    if (blade.empty()) return;
    Point3 low = blade[0].corner[0], high = low;
    for (const BladeTriangle& triangle : blade)
        for (const Point3& x : triangle.corner)
            for (int d = 0; d < 3; d++)
                low[d] = std::min(low[d], x[d] - near), high[d] = std::max(high[d], x[d] + near);
    std::vector<int> reached; // tetrahedra of the mesh whose boxes meet that of the blade
    for (int t = 0; t < int(whole.size()); t++) {
        bool apart = false;
        for (int d = 0; d < 3; d++) {
            const auto at = [&](int k) { return place[3 * size_t(whole[t][k]) + d]; };
            const auto [least, most] = std::minmax({at(0), at(1), at(2), at(3)});
            apart |= least > high[d] || most < low[d];
        }
        if (!apart) reached.push_back(t);
    }
    bool exact = true;
    for (const BladeTriangle& triangle : blade) exact &= slit(triangle, reached);
    // Two triangles nearly in one plane: where they meet, points that the second has made count as on the first one
    // too, and its faces of such points close the gap between both.
    if (!exact)
        for (const BladeTriangle& triangle : blade) slit(triangle, reached);
}

bool SlitComplex::slit(const BladeTriangle& triangle, const std::vector<int>& reached) {
    std::vector<Face> edges; // (low, high, 0): with the faces of two, they are split by the same function
    for (int t : reached) {
        if (!meets(triangle, whole[t])) continue;
        for (int k : pieces[t])
            if (!gone[k] && meets(triangle, corner[k])) active[k] = 1, actives.push_back(k);
    }
    const auto add_edges = [&](const int* points, int count) {
        for (int a = 0; a < count; a++)
            for (int b = a + 1; b < count; b++)
                edges.push_back({std::min(points[a], points[b]), std::max(points[a], points[b]), 0});
    };
    for (int k : actives) add_edges(corner[k].data(), 4);
    std::vector<int8_t> height = split_across([&](const double* x) { return triangle.height(x); }, std::move(edges));
    std::vector<uint8_t> out(height.size());
    std::vector<Face> inside = faces_on(height, out);
    bool exact = true;
    for (const Face& face : inside)
        for (int p : face) exact &= std::abs(triangle.height(&place[3 * size_t(p)])) <= rounding * near;
    for (int side = 0; side < 3; side++) {
        edges = {};
        for (const Face& face : inside) add_edges(face.data(), 3);
        const auto beyond = split_across([&](const double* x) { return triangle.beyond(x, side); }, std::move(edges));
        height.resize(beyond.size()); // points on edges that no side so far has left out
        out.resize(beyond.size());
        for (size_t p = 0; p < beyond.size(); p++) out[p] |= beyond[p] > 0;
        inside = faces_on(height, out);
    }
    for (const Face& face : inside)
        if (common(about(face[0], face[1]), around[face[2]]).size() == 2) cut[face] = triangle.normal;
    for (int k : actives) active[k] = 0;
    actives.clear();
    return exact;
}

// Splits those edges (low, high, 0) that go from one side to the other; -1, 0 or 1 for each point then.
template <class Distance>
std::vector<int8_t> SlitComplex::split_across(const Distance& distance, std::vector<Face> edges) {
    const size_t before = support.size();
    std::vector<double> far(before);
    std::vector<int8_t> side(before);
    for (size_t p = 0; p < before; p++) {
        far[p] = distance(&place[3 * p]);
        side[p] = std::abs(far[p]) <= near ? 0 : far[p] > 0 ? 1 : -1;
    }
    sort_once(edges);
    for (const auto& [a, b, unused] : edges)
        if (side[a] * side[b] < 0) split(a, b, far[a] / (far[a] - far[b]));
    side.resize(support.size());
    return side;
}

// The faces of active tetrahedra that have no point off the plane, and none that is `out`.
std::vector<SlitComplex::Face> SlitComplex::faces_on(const std::vector<int8_t>& height,
                                                     const std::vector<uint8_t>& out) const {
    std::vector<Face> faces;
    for (int k : actives)
        for (int left_out = 0; left_out < 4; left_out++) {
            const auto& c = corner[k];
            const Face face = ascending(c[(left_out + 1) % 4], c[(left_out + 2) % 4], c[(left_out + 3) % 4]);
            if (std::all_of(face.begin(), face.end(), [&](int p) { return height[p] == 0 && !out[p]; }))
                faces.push_back(face);
        }
    sort_once(faces);
    return faces;
}

std::vector<int> SlitComplex::about(int a, int b) const { return common(around[a], around[b]); }

int SlitComplex::split(int a, int b, double t) {
    const int point = int(support.size());
    for (int d = 0; d < 3; d++) place.push_back((1 - t) * place[3 * size_t(a) + d] + t * place[3 * size_t(b) + d]);
    Support between;
    for (int k = 0; k < support[a].count; k++) between.add(support[a].node[k], (1 - t) * support[a].weight[k]);
    for (int k = 0; k < support[b].count; k++) between.add(support[b].node[k], t * support[b].weight[k]);
    support.push_back(between);
    around.emplace_back();
    std::vector<int> link;
    for (int k : about(a, b)) {
        for (int c : corner[k])
            if (c != a && c != b) link.push_back(c);
        halve(k, a, b, point);
    }
    sort_once(link);
    for (int c : link)
        if (const auto found = cut.find(ascending(a, b, c)); found != cut.end()) {
            const Point3 normal = found->second;
            cut.erase(found);
            cut[ascending(a, point, c)] = cut[ascending(point, b, c)] = normal;
        }
    return point;
}

void SlitComplex::halve(int k, int a, int b, int point) {
    const int other = int(parent.size());
    const std::array<int, 4> corners = corner[k];
    corner.push_back(corners);
    std::replace(corner[k].begin(), corner[k].end(), b, point);
    std::replace(corner[other].begin(), corner[other].end(), a, point);
    parent.push_back(parent[k]);
    pieces[parent[k]].push_back(other);
    erase(around[b], k);
    insert(around[point], k);
    insert(around[point], other);
    for (int v : corners)
        if (v != a) insert(around[v], other);
    gone.push_back(gone[k]);
    active.push_back(active[k]);
    if (active[k]) actives.push_back(other);
}

} // namespace palpate
