#include "tissue/contact_surface.h"
#include "tissue/closest_point.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

constexpr double cancelled = 1e-9; // of a vertex's area, what is left of normals that cancel

} // namespace

ContactSurface::ContactSurface(const double* nodes, int count, const int32_t* triangles, int faces,
                               const uint8_t* fixed) {
    std::vector<int> vertex(count, -1);
    corner.resize(3 * size_t(faces));
    for (size_t k = 0; k < corner.size(); k++) vertex[triangles[k]] = 0;
    for (int i = 0; i < count; i++) {
        if (vertex[i] < 0) continue;
        vertex[i] = int(node.size());
        node.push_back(i);
        this->fixed.push_back(fixed[i]);
        for (int k = 0; k < 3; k++) position.push_back(nodes[3 * size_t(i) + k]);
    }
    for (size_t k = 0; k < corner.size(); k++) corner[k] = vertex[triangles[k]];
    area.assign(node.size(), 0);
    normals.assign(3 * node.size(), 0);
    for (int t = 0; t < faces; t++) {
        const int* v = &corner[3 * t];
        double e[3], f[3], n[3];
        minus(&position[3 * v[1]], &position[3 * v[0]], e);
        minus(&position[3 * v[2]], &position[3 * v[0]], f);
        cross(e, f, n);
        for (int c = 0; c < 3; c++) {
            area[v[c]] += length(n) / 6;
            for (int k = 0; k < 3; k++) normals[3 * v[c] + k] += n[k];
        }
    }
    for (size_t i = 0; i < node.size(); i++) { // where the lips of a cut end, they cancel: a normal would be rounding
        const double length = palpate::length(&normals[3 * i]);
        for (int k = 0; k < 3; k++) normals[3 * i + k] *= length > cancelled * area[i] ? 1 / length : 0;
    }
    build_adjacency();
    link_triangles();
    build_tree();
}

void ContactSurface::carry(const int32_t* nodes_of, const double* share, int count, const uint8_t* held, int nodes) {
    carrier.assign(nodes_of, nodes_of + 4 * size_t(count));
    carrier_share.assign(share, share + 4 * size_t(count));
    held_node.assign(held, held + nodes);
}

void ContactSurface::build_adjacency() {
    std::vector<std::pair<int, int>> edges;
    for (size_t t = 0; t < corner.size(); t += 3)
        for (int c = 0; c < 3; c++) {
            int a = corner[t + c], b = corner[t + (c + 1) % 3];
            edges.push_back({a, b});
            edges.push_back({b, a});
        }
    std::sort(edges.begin(), edges.end());
    edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
    start.assign(node.size() + 1, 0);
    for (auto [a, b] : edges) {
        start[a + 1]++;
        neighbour.push_back(b);
    }
    for (size_t i = 0; i < node.size(); i++) start[i + 1] += start[i];
}

// Where more than two triangles meet at an edge, they are linked in a circle, so that a walk across it meets them all.
void ContactSurface::link_triangles() {
    std::vector<std::array<int, 3>> half; // the lower vertex, the higher, 3 triangle + corner
    for (int k = 0; k < int(corner.size()); k++) {
        const int a = corner[k], b = corner[k % 3 == 2 ? k - 2 : k + 1];
        half.push_back({std::min(a, b), std::max(a, b), k});
    }
    std::sort(half.begin(), half.end());
    across.resize(corner.size());
    for (size_t first = 0, last; first < half.size(); first = last) {
        for (last = first; last < half.size() && half[last][0] == half[first][0] && half[last][1] == half[first][1];)
            last++;
        for (size_t k = first; k < last; k++) across[half[k][2]] = half[k + 1 < last ? k + 1 : first][2] / 3;
    }
}

void ContactSurface::build_tree() {
    std::vector<Bounds> bounds(triangles());
    std::vector<double> centre(3 * bounds.size(), 0.0);
    for (size_t t = 0; t < bounds.size(); t++)
        for (int c = 0; c < 3; c++) {
            const double* x = &position[3 * size_t(corner[3 * t + c])];
            bounds[t].add(x);
            for (int k = 0; k < 3; k++) centre[3 * t + k] += x[k];
        }
    tree.build(bounds, centre);
}

SurfaceScratch ContactSurface::scratch() const {
    SurfaceScratch s;
    s.visited.assign(node.size(), 0);
    s.visited_triangle.assign(triangles(), 0);
    s.queue.resize(std::max(node.size(), size_t(triangles())));
    s.entry.resize(node.size());
    if (!carried()) return s;
    s.wide = WidePatch(vertices());
    s.visited_node.assign(held_node.size(), 0);
    s.node_entry.resize(held_node.size());
    return s;
}

SurfacePoint ContactSurface::closest(const double point[3]) const {
    SurfacePoint best;
    double best_distance2 = std::numeric_limits<double>::infinity();
    auto distance2 = [&](const Bounds& box) {
        double sum = 0;
        for (int k = 0; k < 3; k++) {
            double d = std::max({box.low[k] - point[k], point[k] - box.high[k], 0.0});
            sum += d * d;
        }
        return sum;
    };
    int stack[BoxTree::deepest], depth = 0;
    if (!tree.box.empty()) stack[depth++] = 0;
    while (depth > 0) {
        int at = stack[--depth];
        const BoxTree::Box& box = tree.box[at];
        if (best.triangle >= 0 && distance2(box) >= best_distance2) continue; // squares overflow for a point far off
        if (box.count == 0) {
            int left = at + 1, right = box.first;
            bool left_first = distance2(tree.box[left]) <= distance2(tree.box[right]);
            stack[depth++] = left_first ? right : left;
            stack[depth++] = left_first ? left : right;
            continue;
        }
        for (int i = box.first; i < box.first + box.count; i++) {
            const int* v = &corner[3 * tree.order[i]];
            double w[3], q[3];
            closest_weights(point, &position[3 * v[0]], &position[3 * v[1]], &position[3 * v[2]], w);
            for (int k = 0; k < 3; k++)
                q[k] = w[0] * position[3 * v[0] + k] + w[1] * position[3 * v[1] + k] + w[2] * position[3 * v[2] + k];
            if (double square = square_of_distance(point, q); best.triangle < 0 || square < best_distance2) {
                best_distance2 = square;
                best.triangle = tree.order[i];
                for (int k = 0; k < 3; k++) best.weight[k] = w[k], best.point[k] = q[k];
            }
        }
    }
    best.distance = std::sqrt(best_distance2);
    return best;
}

void ContactSurface::normal(const SurfacePoint& at, double out[3]) const {
    const int* v = &corner[3 * at.triangle];
    for (int k = 0; k < 3; k++) {
        out[k] = 0;
        for (int c = 0; c < 3; c++) out[k] += at.weight[c] * normals[3 * v[c] + k];
    }
    const double length = palpate::length(out);
    for (int k = 0; k < 3; k++) out[k] /= length > 0 ? length : 1;
}

} // namespace palpate
