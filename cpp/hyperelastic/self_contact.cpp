#include "hyperelastic/self_contact.h"
#include "tissue/closest_point.h"
#include <algorithm>
#include <limits>

namespace palpate {
namespace {

constexpr double neighbourhood = 3; // edges, at rest: what hangs together within it is no other part
constexpr double facing = -0.5;     // largest cosine between the normals of the sides of a cleft
constexpr double parallel = 0.5;    // and between those of parts that can meet
constexpr size_t most_near = 128;   // triangles near a vertex, on the average
constexpr double reach = 2.5;       // edges from a vertex, within which triangles are near it
constexpr double most_moved = 0.9;  // edges since the last arrival: both parts, and half an edge, within the reach
constexpr double most_alone = 2;    // edges, where no triangle is near
constexpr double infinity = std::numeric_limits<double>::infinity();

void middle(const double* position, const int end[2], double out[3]) {
    for (int k = 0; k < 3; k++) out[k] = (position[3 * size_t(end[0]) + k] + position[3 * size_t(end[1]) + k]) / 2;
}

// The point of a triangle that is closest to a point, and its barycentric weights.
void place(const ContactSurface& surface, const double* position, int triangle, const double* point, double weight[3],
           double out[3]) {
    const int* v = &surface.corner[3 * size_t(triangle)];
    closest_weights(point, position + 3 * size_t(v[0]), position + 3 * size_t(v[1]), position + 3 * size_t(v[2]),
                    weight);
    for (int k = 0; k < 3; k++) {
        out[k] = 0;
        for (int c = 0; c < 3; c++) out[k] += weight[c] * position[3 * size_t(v[c]) + k];
    }
}

// Twice the area long.
void area_normal(const ContactSurface& surface, const double* position, int triangle, double out[3]) {
    const int* v = &surface.corner[3 * size_t(triangle)];
    double e[3], f[3];
    minus(position + 3 * size_t(v[1]), position + 3 * size_t(v[0]), e);
    minus(position + 3 * size_t(v[2]), position + 3 * size_t(v[0]), f);
    cross(e, f, out);
}

void add_unit_normal(const ContactSurface& surface, const double* position, int triangle, double factor,
                     double out[3]) {
    double n[3];
    area_normal(surface, position, triangle, n);
    const double size = length(n);
    for (int k = 0; k < 3 && size > 0; k++) out[k] += factor * n[k] / size;
}

// The angle of a triangle at one of its vertices.
double angle_at(const ContactSurface& surface, const double* position, int triangle, int vertex) {
    const int* v = &surface.corner[3 * size_t(triangle)];
    const int c = int(std::find(v, v + 3, vertex) - v);
    double e[3], f[3], n[3];
    minus(position + 3 * size_t(v[(c + 1) % 3]), position + 3 * size_t(vertex), e);
    minus(position + 3 * size_t(v[(c + 2) % 3]), position + 3 * size_t(vertex), f);
    cross(e, f, n);
    return std::atan2(length(n), dot(e, f));
}

// Boxes around the triangles where these are now: (boxes, 6).
void fit_boxes(const ContactSurface& surface, const double* position, double* box) {
    for (int at = int(surface.tree.size()) - 1; at >= 0; at--) {
        const ContactSurface::Box& node = surface.tree[at];
        double* low = box + 6 * size_t(at);
        std::fill_n(low, 3, infinity), std::fill_n(low + 3, 3, -infinity);
        auto add = [&](const double* least, const double* most) {
            for (int k = 0; k < 3; k++) low[k] = std::min(low[k], least[k]), low[3 + k] = std::max(low[3 + k], most[k]);
        };
        if (node.count == 0) {
            for (int child : {at + 1, node.first}) add(box + 6 * size_t(child), box + 6 * size_t(child) + 3);
            continue;
        }
        for (int i = 3 * node.first; i < 3 * (node.first + node.count); i++) {
            const double* x = position + 3 * size_t(surface.corner[3 * size_t(surface.leaf_order[i / 3]) + i % 3]);
            add(x, x);
        }
    }
}

// Every triangle whose box is within `reach` mm of a point.
template <class Visit>
void visit_near(const ContactSurface& surface, const double* box, const double* point, double reach, Visit&& visit) {
    int stack[128], depth = 0;
    if (!surface.tree.empty()) stack[depth++] = 0;
    while (depth > 0) {
        const int at = stack[--depth];
        const double* low = box + 6 * size_t(at);
        double square = 0;
        for (int k = 0; k < 3; k++) {
            const double d = std::max({low[k] - point[k], point[k] - low[3 + k], 0.0});
            square += d * d;
        }
        if (square > reach * reach) continue;
        const ContactSurface::Box& node = surface.tree[at];
        if (node.count == 0) {
            stack[depth++] = node.first;
            stack[depth++] = at + 1;
            continue;
        }
        for (int i = node.first; i < node.first + node.count; i++) visit(surface.leaf_order[i]);
    }
}

} // namespace

// What a caller keeps: where the vertices are, where they were at the last arrival, the triangles near them there.
struct SelfContact::Near {
    double *known, *position, *reference, *box, *first, *triangle; // 1 if known; first: (vertices + 1)
    double* behind; // (points) 1 if it was met from before, and is behind
};

struct SelfContact::Contact {
    int triangle = -1;
    double weight[3], point[3]; // the closest of the other part
    double normal[3], distance; // from the other part; signed, mm
};

SelfContact::SelfContact(const HyperelasticEnergy& elements, const ContactSurface& surface, const double* mu)
    : elements(elements), surface(surface) {
    const int vertices = surface.vertices();
    around_start.assign(vertices + 1, 0);
    for (int v : surface.corner) around_start[v + 1]++;
    for (int v = 0; v < vertices; v++) around_start[v + 1] += around_start[v];
    around.resize(surface.corner.size());
    std::vector<int> next(around_start);
    for (size_t k = 0; k < around.size(); k++) around[next[surface.corner[k]]++] = int(k / 3);
    add_points(mu);
    exclude_neighbours();
    size = 1 + 6 * size_t(vertices) + 6 * surface.tree.size() + vertices + 1 + most_near * vertices + points.size() +
           vertices;
}

// A twelfth of a triangle's area belongs to each of its corners, a quarter to each middle of an edge.
void SelfContact::add_points(const double* mu) {
    for (int v = 0; v < surface.vertices(); v++) points.push_back({{v, v}, surface.area[v] / 4});
    for (int k = 0; k < int(surface.corner.size()); k++) {
        const int a = surface.corner[k], b = surface.corner[k % 3 == 2 ? k - 2 : k + 1];
        edge += distance(&surface.position[3 * size_t(a)], &surface.position[3 * size_t(b)]) / surface.corner.size();
        if (a > b) continue; // the triangle beyond has it the other way round
        double area = 0;
        for (int t : {k / 3, surface.across[k]}) {
            double normal[3];
            area_normal(surface, surface.position.data(), t, normal);
            area += length(normal) / 2;
        }
        points.push_back({{a, b}, area / 4});
    }
    for (Point& p : points) p.stiffness *= (mu[surface.node[p.end[0]]] + mu[surface.node[p.end[1]]]) / gap;
}

// At rest: the triangles that hang together with each vertex and do not face it, and those within the gap.
void SelfContact::exclude_neighbours() {
    const double* rest = surface.position.data();
    std::vector<double> box(6 * surface.tree.size());
    fit_boxes(surface, rest, box.data());
    std::vector<int> seen(surface.triangles(), -1), front;
    excluded_start.push_back(0);
    for (int v = 0; v < surface.vertices(); v++) {
        const double* x = rest + 3 * size_t(v);
        double q[3];
        auto away = [&](int t) {
            double w[3];
            place(surface, rest, t, x, w, q);
            return distance(x, q);
        };
        auto is_other = [&](int t) {
            if (away(t) < gap) return false;
            double normal[3] = {0, 0, 0}, way[3];
            add_unit_normal(surface, rest, t, 1, normal);
            minus(x, q, way);
            return dot(way, normal) > 0 && dot(&surface.normals[3 * size_t(v)], normal) < facing;
        };
        front.assign(around.begin() + around_start[v], around.begin() + around_start[v + 1]);
        for (int t : front) seen[t] = v;
        for (size_t k = 0; k < front.size(); k++)
            for (int c = 0; c < 3; c++) {
                const int t = surface.across[3 * size_t(front[k]) + c];
                if (seen[t] == v || away(t) > neighbourhood * edge) continue;
                seen[t] = v;
                front.push_back(t);
            }
        front.erase(std::remove_if(front.begin(), front.end(), is_other), front.end());
        visit_near(surface, box.data(), x, gap, [&](int t) {
            if (seen[t] != v && away(t) < gap) front.push_back(t);
        });
        std::sort(front.begin(), front.end());
        excluded.insert(excluded.end(), front.begin(), front.end());
        excluded_start.push_back(int(excluded.size()));
    }
}

bool SelfContact::is_excluded(int vertex, int triangle) const {
    return std::binary_search(&excluded[0] + excluded_start[vertex], &excluded[0] + excluded_start[vertex + 1],
                              triangle);
}

SelfContact::Near SelfContact::near(double* work) const {
    Near n;
    n.known = work + elements.work_size();
    n.position = n.known + 1;
    n.reference = n.position + 3 * size_t(surface.vertices());
    n.box = n.reference + 3 * size_t(surface.vertices());
    n.first = n.box + 6 * surface.tree.size();
    n.triangle = n.first + surface.vertices() + 1;
    n.behind = n.triangle + most_near * surface.vertices();
    return n;
}

// Returns how far the vertices have moved since the last arrival at most, mm.
double SelfContact::place_vertices(const Near& n, const double* u) const {
    double moved = 0;
    for (int v = 0; v < surface.vertices(); v++) {
        double* x = n.position + 3 * size_t(v);
        for (int k = 0; k < 3; k++) x[k] = surface.position[3 * size_t(v) + k] + u[3 * size_t(surface.node[v]) + k];
        moved = std::max(moved, square_of_distance(x, n.reference + 3 * size_t(v)));
    }
    return std::sqrt(moved);
}

// Where there are more than the memory has room for, the last ones are left out.
void SelfContact::find_near(const Near& n) const {
    std::copy_n(n.position, 3 * size_t(surface.vertices()), n.reference);
    fit_boxes(surface, n.position, n.box);
    size_t count = 0;
    const size_t room = most_near * surface.vertices();
    double* any_behind = n.behind + points.size(); // of the points at each vertex
    std::fill_n(any_behind, surface.vertices(), 0.0);
    for (size_t i = 0; i < points.size(); i++)
        for (int v : points[i].end) any_behind[v] = std::max(any_behind[v], n.behind[i]);
    for (int v = 0; v < surface.vertices(); v++) {
        n.first[v] = double(count);
        const double* x = n.position + 3 * size_t(v);
        double own[3] = {0, 0, 0};
        for (int k = around_start[v]; k < around_start[v + 1]; k++)
            add_unit_normal(surface, n.position, around[k], angle_at(surface, n.position, around[k], v), own);
        const double most = parallel * length(own);
        visit_near(surface, n.box, x, reach * edge, [&](int t) {
            double normal[3] = {0, 0, 0};
            add_unit_normal(surface, n.position, t, 1, normal);
            if (count == room || dot(own, normal) > most || is_excluded(v, t)) return;
            Contact at;
            at.triangle = t;
            place(surface, n.position, t, x, at.weight, at.point);
            const double s = signed_distance(n.position, x, at);
            if (s > (any_behind[v] > 0 ? -reach * edge : -2 * gap)) n.triangle[count++] = double(t);
        });
    }
    n.first[surface.vertices()] = double(count);
    *n.known = 1;
}

double SelfContact::farthest(const Near& n) const {
    return (n.first[surface.vertices()] > 0 ? most_moved : most_alone) * edge;
}

bool SelfContact::arrive(const double* u, double* work) const {
    const Near n = near(work);
    if (const double moved = place_vertices(n, u); *n.known > 0 && moved <= 0.5 * farthest(n)) return false;
    for (size_t i = 0; i < points.size(); i++) {
        Contact contact;
        n.behind[i] = *n.known > 0 && contact_of(n, int(i), contact) && contact.distance < 0;
    }
    find_near(n);
    return true;
}

double SelfContact::longest_move(const double* work) const {
    const Near n = near(const_cast<double*>(work));
    return (*n.known > 0 ? 0.5 : 0) * farthest(n);
}

// By the pseudonormal at the closest point: of the face, of both faces at an edge, of all at a vertex by their angles.
double SelfContact::signed_distance(const double* position, const double* x, Contact& at) const {
    const int* v = &surface.corner[3 * size_t(at.triangle)];
    const double* w = at.weight;
    const int corner = int(std::max_element(w, w + 3) - w), without = int(std::min_element(w, w + 3) - w);
    std::fill_n(at.normal, 3, 0.0);
    if (w[corner] == 1) {
        for (int k = around_start[v[corner]]; k < around_start[v[corner] + 1]; k++) {
            const double angle = angle_at(surface, position, around[k], v[corner]);
            add_unit_normal(surface, position, around[k], angle, at.normal);
        }
    } else {
        add_unit_normal(surface, position, at.triangle, 1, at.normal);
        const int beyond = surface.across[3 * size_t(at.triangle) + (without + 1) % 3];
        if (w[without] == 0) add_unit_normal(surface, position, beyond, 1, at.normal);
    }
    double way[3];
    minus(x, at.point, way);
    return std::copysign(length(way), dot(way, at.normal));
}

// Whether a point behind a triangle was before it at the last arrival. Where the surface is bent between the two, so
// that the triangle only turned, the way from it has not.
bool SelfContact::went_through(const Near& n, int point, const Contact& at) const {
    double x[3], before[3], way[3];
    middle(n.position, points[point].end, x);
    minus(x, at.point, way);
    Contact then;
    then.triangle = at.triangle;
    middle(n.reference, points[point].end, x);
    place(surface, n.reference, at.triangle, x, then.weight, then.point);
    minus(x, then.point, before);
    const double s = signed_distance(n.reference, x, then);
    return s >= 0 ? dot(before, way) < 0 : s > -2 * gap || n.behind[point] > 0;
}

// The closest point of the other parts near a point, if it is close enough to be a contact.
bool SelfContact::contact_of(const Near& n, int number, Contact& found) const {
    const Point& point = points[number];
    double x[3], least = infinity;
    middle(n.position, point.end, x);
    for (int e = 0; e < (point.end[0] == point.end[1] ? 1 : 2); e++)
        for (int i = int(n.first[point.end[e]]); i < int(n.first[point.end[e] + 1]); i++) {
            double w[3], q[3];
            place(surface, n.position, int(n.triangle[i]), x, w, q);
            if (const double square = square_of_distance(x, q);
                square < least && !is_excluded(point.end[1 - e], int(n.triangle[i]))) {
                least = square, found.triangle = int(n.triangle[i]);
                std::copy_n(w, 3, found.weight), std::copy_n(q, 3, found.point);
            }
        }
    if (found.triangle < 0) return false;
    found.distance = signed_distance(n.position, x, found);
    if (!(found.distance < gap) || (found.distance < -gap && !went_through(n, number, found))) return false;
    const bool touching = std::abs(found.distance) < 1e-9; // mm
    const double size = touching ? length(found.normal) : found.distance;
    for (int k = 0; k < 3; k++) found.normal[k] = (touching ? found.normal[k] : x[k] - found.point[k]) / size;
    return true;
}

// False if the vertices have moved too far since the last arrival.
template <class Act> bool SelfContact::for_each_contact(const double* u, double* work, Act&& act) const {
    const Near n = near(work);
    const double moved = place_vertices(n, u);
    if (*n.known == 0)
        find_near(n);
    else if (moved > farthest(n))
        return false;
    if (n.first[surface.vertices()] == 0) return true;
    for (size_t i = 0; i < points.size(); i++) {
        Contact contact;
        if (!contact_of(n, int(i), contact)) continue;
        const Point& point = points[i];
        const int* other = &surface.corner[3 * size_t(contact.triangle)];
        const int node[5] = {surface.node[point.end[0]], surface.node[point.end[1]], surface.node[other[0]],
                             surface.node[other[1]], surface.node[other[2]]};
        const double share[5] = {0.5, 0.5, -contact.weight[0], -contact.weight[1], -contact.weight[2]};
        act(point.stiffness, contact, node, share);
    }
    return true;
}

HyperelasticEnergy::Energy SelfContact::energy(const double* u, double* force, double* ratio, double* work) const {
    Energy found = elements.energy(u, force, ratio, work);
    if (!std::isfinite(found.value)) return found;
    const bool near =
        for_each_contact(u, work, [&](double stiffness, const Contact& c, const int* node, const double* share) {
            const double depth = gap - c.distance;
            found.value += 0.5 * stiffness * depth * depth;
            for (int i = 0; i < 5; i++)
                for (int k = 0; k < 3; k++)
                    force[3 * size_t(node[i]) + k] -= stiffness * depth * share[i] * c.normal[k];
        });
    if (!near) found.value = infinity;
    return found;
}

void SelfContact::tangent(const double* u, const double* v, int count, double* out, double* work) const {
    elements.tangent(u, v, count, out, work);
    const size_t stride = 3 * size_t(nodes());
    for_each_contact(u, work, [&](double stiffness, const Contact& c, const int* node, const double* share) {
        for (size_t d = 0; d < count * stride; d += stride) {
            double closer = 0;
            for (int i = 0; i < 5; i++) closer += share[i] * dot(v + d + 3 * size_t(node[i]), c.normal);
            for (int i = 0; i < 5; i++)
                for (int k = 0; k < 3; k++)
                    out[d + 3 * size_t(node[i]) + k] += stiffness * closer * share[i] * c.normal[k];
        }
    });
}

} // namespace palpate
