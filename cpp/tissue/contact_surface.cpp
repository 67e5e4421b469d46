#include "tissue/contact_surface.h"
#include "base/vec3.h"
#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

void minus(const double* a, const double* b, double* out) {
    for (int k = 0; k < 3; k++) out[k] = a[k] - b[k];
}
void cross(const double* a, const double* b, double* out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

// Barycentric weights of the triangle's point closest to p, by the Voronoi regions of corners, edges and face.
void closest_weights(const double* p, const double* a, const double* b, const double* c, double w[3]) {
    double ab[3], ac[3], ap[3], bp[3], cp[3];
    minus(b, a, ab), minus(c, a, ac), minus(p, a, ap), minus(p, b, bp), minus(p, c, cp);
    auto set = [&](double u, double v, double x) { w[0] = u, w[1] = v, w[2] = x; };
    double d1 = dot(ab, ap), d2 = dot(ac, ap);
    if (d1 <= 0 && d2 <= 0) return set(1, 0, 0);
    double d3 = dot(ab, bp), d4 = dot(ac, bp);
    if (d3 >= 0 && d4 <= d3) return set(0, 1, 0);
    double d5 = dot(ab, cp), d6 = dot(ac, cp);
    if (d6 >= 0 && d5 <= d6) return set(0, 0, 1);
    double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return set(1 - d1 / (d1 - d3), d1 / (d1 - d3), 0);
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return set(1 - d2 / (d2 - d6), 0, d2 / (d2 - d6));
    double from_b = d4 - d3, from_c = d5 - d6;
    if (va <= 0 && from_b >= 0 && from_c >= 0) return set(0, from_c / (from_b + from_c), from_b / (from_b + from_c));
    double sum = va + vb + vc;
    set(va / sum, vb / sum, vc / sum);
}

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
    for (size_t i = 0; i < node.size(); i++) {
        double length = std::sqrt(dot(&normals[3 * i], &normals[3 * i]));
        for (int k = 0; k < 3; k++) normals[3 * i + k] /= length > 0 ? length : 1;
    }
    build_adjacency();
    leaf_order.resize(faces);
    for (int t = 0; t < faces; t++) leaf_order[t] = t;
    tree.reserve(2 * size_t(faces) + 1);
    if (faces > 0) build_tree(0, faces);
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

// A tree of boxes over the triangles: split at the median of the longest side, at most four triangles per leaf.
int ContactSurface::build_tree(int first, int count) {
    const int index = int(tree.size());
    tree.push_back({});
    Box box{{1e300, 1e300, 1e300}, {-1e300, -1e300, -1e300}, first, count};
    for (int i = first; i < first + count; i++)
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++) {
                double x = position[3 * corner[3 * leaf_order[i] + c] + k];
                box.low[k] = std::min(box.low[k], x);
                box.high[k] = std::max(box.high[k], x);
            }
    if (count > 4) {
        int axis = 0;
        for (int k = 1; k < 3; k++)
            if (box.high[k] - box.low[k] > box.high[axis] - box.low[axis]) axis = k;
        auto centre = [&](int t) {
            return position[3 * corner[3 * t] + axis] + position[3 * corner[3 * t + 1] + axis] +
                   position[3 * corner[3 * t + 2] + axis];
        };
        auto begin = leaf_order.begin() + first;
        std::nth_element(begin, begin + count / 2, begin + count, [&](int a, int b) {
            double x = centre(a), y = centre(b);
            return x < y || (x == y && a < b);
        });
        build_tree(first, count / 2);
        box.first = build_tree(first + count / 2, count - count / 2);
        box.count = 0;
    }
    tree[index] = box;
    return index;
}

SurfaceScratch ContactSurface::scratch() const {
    SurfaceScratch s;
    s.visited.assign(node.size(), 0);
    s.queue.resize(node.size());
    return s;
}

SurfacePoint ContactSurface::closest(const double point[3]) const {
    SurfacePoint best;
    double best_distance2 = std::numeric_limits<double>::infinity();
    auto distance2 = [&](const Box& box) {
        double sum = 0;
        for (int k = 0; k < 3; k++) {
            double d = std::max({box.low[k] - point[k], point[k] - box.high[k], 0.0});
            sum += d * d;
        }
        return sum;
    };
    int stack[128], depth = 0;
    if (!tree.empty()) stack[depth++] = 0;
    while (depth > 0) {
        int at = stack[--depth];
        const Box& box = tree[at];
        if (distance2(box) >= best_distance2) continue;
        if (box.count == 0) {
            int left = at + 1, right = box.first;
            bool left_first = distance2(tree[left]) <= distance2(tree[right]);
            stack[depth++] = left_first ? right : left;
            stack[depth++] = left_first ? left : right;
            continue;
        }
        for (int i = box.first; i < box.first + box.count; i++) {
            const int* v = &corner[3 * leaf_order[i]];
            double w[3], q[3];
            closest_weights(point, &position[3 * v[0]], &position[3 * v[1]], &position[3 * v[2]], w);
            for (int k = 0; k < 3; k++)
                q[k] = w[0] * position[3 * v[0] + k] + w[1] * position[3 * v[1] + k] + w[2] * position[3 * v[2] + k];
            if (double square = square_of_distance(point, q); square < best_distance2) {
                best_distance2 = square;
                best.triangle = leaf_order[i];
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
    double length = std::sqrt(dot(out, out));
    for (int k = 0; k < 3; k++) out[k] /= length > 0 ? length : 1;
}

ContactSurface::PatchStatus ContactSurface::patch(const SurfacePoint& at, double radius, SurfaceScratch& s,
                                                  ContactPatch& patch) const {
    const int* corners = &corner[3 * at.triangle];
    double n[3], total = 0;
    normal(at, n);
    patch.count = 0;
    if (++s.generation == 0) { // the counter has wrapped: clear the marks
        std::fill(s.visited.begin(), s.visited.end(), 0);
        s.generation = 1;
    }
    int head = 0, tail = 0, inside = 0;
    for (int c = 0; c < 3; c++) s.queue[tail++] = corners[c], s.visited[corners[c]] = s.generation;
    while (head < tail) {
        int i = s.queue[head++];
        double alignment = 1 + dot(n, &normals[3 * i]), square = square_of_distance(&position[3 * i], at.point);
        double falloff = alignment > 1e-9 ? 1 - 2 * square / (alignment * radius * radius) : -1;
        if (falloff > 0) {
            inside++;
            if (!fixed[i]) {
                if (patch.count == ContactPatch::capacity) return PatchStatus::too_many_nodes;
                patch.node[patch.count] = node[i];
                patch.weight[patch.count++] = area[i] * falloff * falloff;
                total += area[i] * falloff * falloff;
            }
        }
        if (falloff <= 0) continue;
        for (int k = start[i]; k < start[i + 1]; k++)
            if (int j = neighbour[k]; s.visited[j] != s.generation) s.visited[j] = s.generation, s.queue[tail++] = j;
    }
    if (inside == 0)
        for (int c = 0; c < 3; c++)
            if (!fixed[corners[c]] && at.weight[c] > 0) {
                patch.node[patch.count] = node[corners[c]];
                patch.weight[patch.count++] = at.weight[c];
                total += at.weight[c];
            }
    if (patch.count == 0 || total <= 0) return PatchStatus::all_fixed;
    for (int k = 0; k < patch.count; k++) patch.weight[k] /= total;
    return PatchStatus::good;
}

} // namespace palpate
