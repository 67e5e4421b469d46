// Weights of contact patches: the integral of each shape function against the patch's falloff, and those of version
// 0.1. Called by ToolProxy in the loop's thread, and from Python; allocates nothing. Quadrature: J. Radon, Zur
// mechanischen Kubatur, Monatsh. Math. 52 (1948) 286: seven points, exact to degree five.
#include "base/cpu_dispatch.h"
#include "base/vec3.h"
#include "tissue/contact_surface.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int points = 8; // of Radon's rule, the last one with weight 0, so that a loop over them is vector code
constexpr double least_alignment = 1e-9;

// The rule on a part of the unit triangle: barycentric coordinates of its points and corners; weights sum to the part.
struct Part {
    double at[3][points], weight[points], corner[3][3];
};

// The triangle, its four quarters, and their quarters: part k is cut into 4k + 1 .. 4k + 4.
struct Parts {
    Part part[21];
    Parts() {
        const double whole[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
        set(0, whole, 1);
        for (int k = 0; k < 5; k++) cut(k);
    }

private:
    void set(int k, const double corner[3][3], double share) {
        const double root = std::sqrt(15.0), near[2] = {(6 - root) / 21, (6 + root) / 21},
                     weight[2] = {(155 - root) / 1200, (155 + root) / 1200};
        double local[points][3] = {{1 / 3.0, 1 / 3.0, 1 / 3.0}}, w[points] = {9 / 40.0};
        for (int ring = 0; ring < 2; ring++)
            for (int c = 0; c < 3; c++) {
                const int i = 1 + 3 * ring + c;
                for (int j = 0; j < 3; j++) local[i][j] = j == c ? 1 - 2 * near[ring] : near[ring];
                w[i] = weight[ring];
            }
        std::copy_n(local[0], 3, local[points - 1]);
        for (int i = 0; i < points; i++) {
            part[k].weight[i] = share * w[i];
            for (int j = 0; j < 3; j++)
                part[k].at[j][i] = local[i][0] * corner[0][j] + local[i][1] * corner[1][j] + local[i][2] * corner[2][j];
        }
        for (int c = 0; c < 3; c++) std::copy_n(corner[c], 3, part[k].corner[c]);
    }
    void cut(int k) {
        const double (&from)[3][3] = part[k].corner;
        const double share = k == 0 ? 1 / 4.0 : 1 / 16.0;
        double middle[3][3]; // of the edge opposite to each corner
        for (int c = 0; c < 3; c++)
            for (int j = 0; j < 3; j++) middle[c][j] = (from[(c + 1) % 3][j] + from[(c + 2) % 3][j]) / 2;
        for (int c = 0; c < 3; c++) {
            double quarter[3][3];
            for (int j = 0; j < 3; j++)
                quarter[c][j] = from[c][j], quarter[(c + 1) % 3][j] = middle[(c + 2) % 3][j],
                quarter[(c + 2) % 3][j] = middle[(c + 1) % 3][j];
            set(4 * k + 1 + c, quarter, share);
        }
        set(4 * k + 4, middle, share);
    }
};
const Parts parts;

// What the falloff needs of a triangle: 1 - (quadratic form of the barycentric coordinates) / (linear form of them).
struct Falloff {
    double square[3], twice[3]; // 2 |o_c|^2 / r^2 and 4 o_c.o_c+1 / r^2, o the corners' offsets from the contact
    double alignment[3];        // 1 + n.n_c

    PALPATE_INLINE double form(double a, double b, double c) const {
        return a * (a * square[0] + b * twice[0]) + b * (b * square[1] + c * twice[1]) +
               c * (c * square[2] + a * twice[2]);
    }
    PALPATE_INLINE double operator()(double a, double b, double c) const { // or less than 0
        const double align = a * alignment[0] + b * alignment[1] + c * alignment[2];
        return 1 - form(a, b, c) / (align > least_alignment ? align : least_alignment);
    }
    PALPATE_INLINE bool inside(const double (&l)[3]) const {
        const double align = l[0] * alignment[0] + l[1] * alignment[1] + l[2] * alignment[2];
        return form(l[0], l[1], l[2]) < align && align > least_alignment;
    }

    // Whether an edge is longer than 0.8 radii, so that quarters are still too large for the rule.
    PALPATE_INLINE bool coarse() const {
        constexpr double most = 2 * 0.64;
        return square[0] + square[1] - twice[0] > most || square[1] + square[2] - twice[1] > most ||
               square[2] + square[0] - twice[2] > most;
    }

    // Whether the edge from corner c to the next one is inside somewhere: at its ends or at its point nearest to the
    // contact.
    bool reaches_edge(int c, const bool corner[3]) const {
        const int d = (c + 1) % 3;
        if (corner[c] || corner[d]) return true;
        const double length2 = square[c] + square[d] - twice[c];
        const double t = length2 > 0 ? std::clamp((square[c] - twice[c] / 2) / length2, 0.0, 1.0) : 0;
        double l[3] = {0, 0, 0};
        l[c] = 1 - t, l[d] = t;
        return inside(l);
    }
};

PALPATE_INLINE void add_part(const Part& p, const Falloff& falloff, double (&sum)[3][points]) {
    for (int k = 0; k < points; k++) {
        const double f = falloff(p.at[0][k], p.at[1][k], p.at[2][k]), value = f > 0 ? p.weight[k] * f * f : 0;
        for (int c = 0; c < 3; c++) sum[c][k] += value * p.at[c][k];
    }
}

PALPATE_INLINE void add_rim(const Falloff& falloff, const bool corner[3], double (&sum)[3][points]) {
    bool middle[3]; // inside: the middle of the edge opposite to each corner
    for (int c = 0; c < 3; c++) middle[c] = falloff.inside(parts.part[4].corner[c]);
    for (int k = 1; k < 5; k++) {
        bool at[3] = {middle[0], middle[1], middle[2]}, inner[3]; // the part's corners, and the middles of its edges
        if (k < 4) at[k - 1] = corner[k - 1], at[k % 3] = middle[(k + 1) % 3], at[(k + 1) % 3] = middle[k % 3];
        if (!falloff.coarse() || (at[0] && at[1] && at[2])) {
            add_part(parts.part[k], falloff, sum);
            continue;
        }
        for (int c = 0; c < 3; c++) inner[c] = falloff.inside(parts.part[4 * k + 4].corner[c]);
        for (int c = 0; c < 3; c++)
            if (at[c] || inner[(c + 1) % 3] || inner[(c + 2) % 3]) add_part(parts.part[4 * k + 1 + c], falloff, sum);
        if (inner[0] || inner[1] || inner[2]) add_part(parts.part[4 * k + 4], falloff, sum);
    }
}

// out: the integrals of phi times each shape function over the triangle, divided by its area. Triangles on the rim are
// cut in four, and so are the quarters on the rim of coarse ones; small parts that are outside are left out.
PALPATE_KERNEL void integrate(const Falloff& falloff, const bool corner[3], double out[3]) {
    double sum[3][points] = {};
    if (corner[0] && corner[1] && corner[2])
        add_part(parts.part[0], falloff, sum);
    else
        add_rim(falloff, corner, sum);
    for (int c = 0; c < 3; c++) {
        out[c] = 0;
        for (double s : sum[c]) out[c] += s;
    }
}

void next_generation(SurfaceScratch& s) {
    if (++s.generation != 0) return;
    std::fill(s.visited.begin(), s.visited.end(), 0); // the counter has wrapped: clears the marks
    std::fill(s.visited_triangle.begin(), s.visited_triangle.end(), 0);
    std::fill(s.visited_node.begin(), s.visited_node.end(), 0);
    s.generation = 1;
}

double twice_area(const double* a, const double* b, const double* c) {
    const double e[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]}, f[3] = {c[0] - a[0], c[1] - a[1], c[2] - a[2]};
    const double n[3] = {e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]};
    return length(n);
}

} // namespace

template <class Patch>
ContactSurface::PatchStatus ContactSurface::integral_patch(const SurfacePoint& at, double radius, SurfaceScratch& s,
                                                           Patch& patch) const {
    double n[3], total = 0, offset[3][3];
    normal(at, n);
    patch.count = 0;
    next_generation(s);
    bool any_inside = false, any_free = false;
    s.queue[0] = at.triangle, s.visited_triangle[at.triangle] = s.generation, s.found = 1;
    for (int head = 0; head < s.found; head++) {
        const int t = s.queue[head], *v = &corner[3 * size_t(t)];
        Falloff falloff;
        double share[3];
        bool inside[3];
        for (int c = 0; c < 3; c++) {
            for (int k = 0; k < 3; k++) offset[c][k] = position[3 * size_t(v[c]) + k] - at.point[k];
            falloff.alignment[c] = 1 + dot(n, &normals[3 * size_t(v[c])]);
        }
        for (int c = 0; c < 3; c++) {
            falloff.square[c] = 2 * dot(offset[c], offset[c]) / (radius * radius);
            falloff.twice[c] = 4 * dot(offset[c], offset[(c + 1) % 3]) / (radius * radius);
        }
        for (int c = 0; c < 3; c++) {
            inside[c] = falloff.square[c] < falloff.alignment[c] && falloff.alignment[c] > least_alignment;
            any_inside = any_inside || inside[c];
            any_free = any_free || (inside[c] && !fixed[v[c]]);
        }
        for (int c = 0; c < 3; c++) {
            const int other = across[3 * size_t(t) + c];
            if (s.visited_triangle[other] == s.generation || !falloff.reaches_edge(c, inside)) continue;
            s.visited_triangle[other] = s.generation, s.queue[s.found++] = other;
        }
        integrate(falloff, inside, share);
        const double area =
            twice_area(&position[3 * size_t(v[0])], &position[3 * size_t(v[1])], &position[3 * size_t(v[2])]) / 2;
        for (int c = 0; c < 3; c++) {
            if (fixed[v[c]] || !(share[c] > 0)) continue;
            if (s.visited[v[c]] != s.generation) {
                if (patch.count == patch.capacity) return PatchStatus::too_many_nodes;
                s.visited[v[c]] = s.generation, s.entry[v[c]] = patch.count;
                patch.node[patch.count] = node[v[c]], patch.weight[patch.count++] = 0;
            }
            patch.weight[s.entry[v[c]]] += area * share[c];
            total += area * share[c];
        }
    }
    if (!any_inside) return barycentric_patch(at, patch);
    if (!any_free || !(total > 0)) return PatchStatus::all_fixed;
    for (int k = 0; k < patch.count; k++) patch.weight[k] /= total;
    return PatchStatus::good;
}

template <class Patch>
ContactSurface::PatchStatus ContactSurface::barycentric_patch(const SurfacePoint& at, Patch& patch) const {
    const int* corners = &corner[3 * size_t(at.triangle)];
    double total = 0;
    patch.count = 0;
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

ContactSurface::PatchStatus ContactSurface::patch(const SurfacePoint& at, double radius, SurfaceScratch& s,
                                                  ContactPatch& patch) const {
    if (!carried()) return integral_patch(at, radius, s, patch);
    const PatchStatus found = integral_patch(at, radius, s, s.wide);
    return found == PatchStatus::good ? hand_to_nodes(s, patch) : found;
}

// The mean over the vertices is the same mean over the nodes that move them; without held nodes, as if those moved too.
ContactSurface::PatchStatus ContactSurface::hand_to_nodes(SurfaceScratch& s, ContactPatch& patch) const {
    double total = 0;
    patch.count = 0;
    for (int i = 0; i < s.wide.count; i++)
        for (size_t k = 4 * size_t(s.wide.node[i]), end = k + 4; k < end; k++) {
            const int n = carrier[k];
            if (carrier_share[k] == 0 || held_node[n]) continue;
            if (s.visited_node[n] != s.generation) {
                if (patch.count == patch.capacity) return PatchStatus::too_many_nodes;
                s.visited_node[n] = s.generation, s.node_entry[n] = patch.count;
                patch.node[patch.count] = n, patch.weight[patch.count++] = 0;
            }
            patch.weight[s.node_entry[n]] += s.wide.weight[i] * carrier_share[k];
            total += s.wide.weight[i] * carrier_share[k];
        }
    if (!(total > 0)) return PatchStatus::all_fixed;
    for (int k = 0; k < patch.count; k++) patch.weight[k] /= total;
    return PatchStatus::good;
}

ContactSurface::PatchStatus ContactSurface::patch(const SurfacePoint& at, double radius, SurfaceScratch& s,
                                                  WidePatch& patch) const {
    return integral_patch(at, radius, s, patch);
}

ContactSurface::PatchStatus ContactSurface::nodal_patch(const SurfacePoint& at, double radius, SurfaceScratch& s,
                                                        ContactPatch& patch) const {
    const int* corners = &corner[3 * at.triangle];
    double n[3], total = 0;
    normal(at, n);
    patch.count = 0;
    next_generation(s);
    int head = 0, tail = 0, inside = 0;
    for (int c = 0; c < 3; c++) s.queue[tail++] = corners[c], s.visited[corners[c]] = s.generation;
    while (head < tail) {
        int i = s.queue[head++];
        double offset[3];
        for (int k = 0; k < 3; k++) offset[k] = position[3 * i + k] - at.point[k];
        double alignment = 1 + dot(n, &normals[3 * i]);
        double falloff = alignment > 1e-9 ? 1 - 2 * dot(offset, offset) / (alignment * radius * radius) : -1;
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
    if (inside == 0) return barycentric_patch(at, patch);
    if (patch.count == 0 || total <= 0) return PatchStatus::all_fixed;
    for (int k = 0; k < patch.count; k++) patch.weight[k] /= total;
    return PatchStatus::good;
}

} // namespace palpate
