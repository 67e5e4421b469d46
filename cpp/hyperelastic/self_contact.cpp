#include "hyperelastic/self_contact.h"
#include "tissue/deformed_surface.h"
#include <algorithm>
#include <limits>

namespace palpate {
namespace {

constexpr double neighbourhood = 3; // edges, at rest: what hangs together within it is no other part
constexpr double stiffer = 3;       // of the contact's stiffness, what is added where parts overlap
constexpr double facing = -0.5;     // largest cosine between the normals of the sides of a cleft
constexpr double parallel = 0.5;    // and between those of parts that can meet
constexpr size_t most_near = 128;   // triangles near a vertex, on the average
constexpr double reach = 2.5;       // edges from a vertex, within which triangles are near it
constexpr double most_moved = 0.9; // edges since the last accepted step: both parts, and half an edge, within the reach
constexpr double most_alone = 2;   // edges, where no triangle is near
constexpr double refreshed = 0.5;  // of the largest move: a step that goes further finds the triangles again
constexpr double infinity = std::numeric_limits<double>::infinity();

void middle(const double* position, const int end[2], double out[3]) {
    for (int k = 0; k < 3; k++) out[k] = (position[3 * size_t(end[0]) + k] + position[3 * size_t(end[1]) + k]) / 2;
}

} // namespace

// What a caller keeps: where the vertices are, where they were in the last accepted step, the triangles near them
// there.
struct SelfContact::Near {
    double *known, *position, *reference, *box, *first, *triangle; // 1 if known; first: (vertices + 1)
    double* away;   // (triangles near) mm, how far the vertex was before each then, ascending for each vertex
    double* moved;  // mm, of a vertex since then, at most
    double* mark;   // (triangles) 1 + the last vertex that excluded each
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
    size = 2 + 6 * size_t(vertices) + 6 * surface.tree.box.size() + vertices + 1 + 2 * most_near * vertices +
           points.size() + vertices + surface.triangles();
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
    for (Point& p : points) p.stiffness *= (mu[surface.node[p.end[0]]] + mu[surface.node[p.end[1]]]) / (4 * gap);
}

// At rest: the triangles that hang together with each vertex and do not face it, and those within the gap.
void SelfContact::exclude_neighbours() {
    const double* rest = surface.position.data();
    std::vector<double> box(6 * surface.tree.box.size());
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
    n.moved = n.known + 1;
    n.position = n.moved + 1;
    n.reference = n.position + 3 * size_t(surface.vertices());
    n.box = n.reference + 3 * size_t(surface.vertices());
    n.first = n.box + 6 * surface.tree.box.size();
    n.triangle = n.first + surface.vertices() + 1;
    n.away = n.triangle + most_near * surface.vertices();
    n.mark = n.away + most_near * surface.vertices();
    n.behind = n.mark + surface.triangles();
    return n;
}

// Returns how far the vertices have moved since the last accepted step at most, mm.
double SelfContact::place_vertices(const Near& n, const double* u) const {
    double moved = 0;
    for (int v = 0; v < surface.vertices(); v++) {
        double* x = n.position + 3 * size_t(v);
        for (int k = 0; k < 3; k++) x[k] = surface.position[3 * size_t(v) + k] + u[3 * size_t(surface.node[v]) + k];
        moved = std::max(moved, square_of_distance(x, n.reference + 3 * size_t(v)));
    }
    return *n.moved = std::sqrt(moved);
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
        for (int i = excluded_start[v]; i < excluded_start[v + 1]; i++) n.mark[excluded[i]] = v + 1;
        double own[3] = {0, 0, 0}; // its normal, once a triangle asks for it
        visit_near(surface, n.box, x, reach * edge, [&](int t) {
            if (count == room || n.mark[t] == v + 1) return;
            if (dot(own, own) == 0) add_vertex_normal(n.position, v, own);
            double normal[3] = {0, 0, 0};
            add_unit_normal(surface, n.position, t, 1, normal);
            if (dot(own, normal) > parallel * length(own)) return;
            Contact at;
            at.triangle = t;
            place(surface, n.position, t, x, at.weight, at.point);
            const double s = signed_distance(n.position, x, at);
            if (!(s > (any_behind[v] > 0 ? -reach * edge : -2 * gap))) return;
            const double before = std::max(s, 0.0); // what is behind stays
            size_t i = count++;
            for (; i > size_t(n.first[v]) && n.away[i - 1] > before; i--)
                n.away[i] = n.away[i - 1], n.triangle[i] = n.triangle[i - 1];
            n.away[i] = before, n.triangle[i] = double(t);
        });
    }
    n.first[surface.vertices()] = double(count);
    *n.known = 1, *n.moved = 0;
}

double SelfContact::farthest(const Near& n) const {
    return (n.first[surface.vertices()] > 0 ? most_moved : most_alone) * edge;
}

bool SelfContact::accept(const double* u, double* work) const {
    const Near n = near(work);
    const double moved = place_vertices(n, u);
    if (*n.known > 0 && moved <= refreshed * farthest(n)) return false;
    const bool follows = *n.known > 0 && moved <= farthest(n); // else a caller has set u
    for (size_t i = 0; i < points.size(); i++) {
        Contact contact;
        n.behind[i] = follows && contact_of(n, int(i), contact) && contact.distance < 0;
    }
    find_near(n);
    return true;
}

double SelfContact::longest_move(const double* work) const {
    const Near n = near(const_cast<double*>(work));
    return (*n.known > 0 ? 1 - refreshed : 0) * farthest(n);
}

// Unit normals of the triangles at a vertex, by their angles.
void SelfContact::add_vertex_normal(const double* position, int vertex, double out[3]) const {
    for (int k = around_start[vertex]; k < around_start[vertex + 1]; k++)
        add_unit_normal(surface, position, around[k], angle_at(surface, position, around[k], vertex), out);
}

// By the pseudonormal at the closest point: of the face, of both faces at an edge, of all at a vertex by their angles.
double SelfContact::signed_distance(const double* position, const double* x, Contact& at) const {
    const int* v = &surface.corner[3 * size_t(at.triangle)];
    const double* w = at.weight;
    const int corner = int(std::max_element(w, w + 3) - w), without = int(std::min_element(w, w + 3) - w);
    std::fill_n(at.normal, 3, 0.0);
    if (w[corner] == 1) {
        add_vertex_normal(position, v[corner], at.normal);
    } else {
        add_unit_normal(surface, position, at.triangle, 1, at.normal);
        const int beyond = surface.across[3 * size_t(at.triangle) + (without + 1) % 3];
        if (w[without] == 0) add_unit_normal(surface, position, beyond, 1, at.normal);
    }
    double way[3];
    minus(x, at.point, way);
    return std::copysign(length(way), dot(way, at.normal));
}

// Whether a point behind a triangle was before it in the last accepted step. Where the surface is bent between the two,
// so that the triangle only turned, the way from it has not.
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
    // Neither it nor a triangle has moved further than *n.moved.
    const double* from = n.reference;
    const double half = distance(from + 3 * size_t(point.end[0]), from + 3 * size_t(point.end[1])) / 2;
    const double farthest = gap + half + 2 * *n.moved;
    for (int e = 0; e < (point.end[0] == point.end[1] ? 1 : 2); e++)
        for (int i = int(n.first[point.end[e]]); i < int(n.first[point.end[e] + 1]) && n.away[i] <= farthest; i++) {
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

// False if the vertices have moved too far since the last accepted step.
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
            const double within = gap - c.distance, overlap = std::max(0.0, -c.distance);
            const double push = stiffness * (within + stiffer * overlap);
            found.value += 0.5 * stiffness * (within * within + stiffer * overlap * overlap);
            for (int i = 0; i < 5; i++)
                for (int k = 0; k < 3; k++) force[3 * size_t(node[i]) + k] -= push * share[i] * c.normal[k];
        });
    if (!near) found.value = infinity;
    return found;
}

void SelfContact::tangent(const double* u, const double* v, int count, double* out, double* work) const {
    elements.tangent(u, v, count, out, work);
    const size_t stride = 3 * size_t(nodes());
    for_each_contact(u, work, [&](double stiffness, const Contact& c, const int* node, const double* share) {
        const double slope = (c.distance < 0 ? 1 + stiffer : 1) * stiffness;
        for (size_t d = 0; d < count * stride; d += stride) {
            double closer = 0;
            for (int i = 0; i < 5; i++) closer += share[i] * dot(v + d + 3 * size_t(node[i]), c.normal);
            for (int i = 0; i < 5; i++)
                for (int k = 0; k < 3; k++) out[d + 3 * size_t(node[i]) + k] += slope * closer * share[i] * c.normal[k];
        }
    });
}

} // namespace palpate
