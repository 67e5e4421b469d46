#include "cutting/slit_parts.h"
#include "base/vec3.h"
#include "cutting/disjoint_sets.h"
#include "tissue/closest_point.h"
#include <algorithm>

namespace palpate {
namespace {

double volume_of(const SlitComplex& slit, const std::array<int, 4>& corner) {
    double side[3][3];
    for (int k = 0; k < 3; k++)
        for (int d = 0; d < 3; d++)
            side[k][d] = slit.place[3 * size_t(corner[k + 1]) + d] - slit.place[3 * size_t(corner[0]) + d];
    const auto [a, b, c] = side;
    return (a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
            a[2] * (b[0] * c[1] - b[1] * c[0])) /
           6;
}

} // namespace

SlitParts::SlitParts(const SlitComplex& slit)
    : slit(slit), beyond(4 * slit.corner.size(), -1), passed(4 * slit.corner.size()), above(4 * slit.corner.size()) {
    for (const auto& corner : slit.corner) volume.push_back(volume_of(slit, corner));
    pair_faces();
    mark_passed();
    do group();
    while (stick_crumbs());
}

// Faces by their lowest point, then by the other two: two of the same points are those of neighbours.
void SlitParts::pair_faces() {
    using Half = std::array<int, 3>; // the middle point, the highest, the face
    std::vector<int> start(slit.support.size() + 1);
    std::vector<std::array<int, 3>> points(beyond.size());
    for (int face = 0; face < int(points.size()); face++) {
        const auto& corner = slit.corner[face / 4];
        for (int k = 0; k < 3; k++) points[face][k] = corner[tet_face[face % 4][k]];
        std::sort(points[face].begin(), points[face].end());
        start[points[face][0] + 1]++;
    }
    for (size_t p = 1; p < start.size(); p++) start[p] += start[p - 1];
    std::vector<Half> half(points.size());
    std::vector<int> at(start.begin(), start.end() - 1);
    for (int face = 0; face < int(points.size()); face++)
        half[at[points[face][0]]++] = {points[face][1], points[face][2], face};
    for (size_t p = 0; p + 1 < start.size(); p++) {
        std::sort(&half[0] + start[p], &half[0] + start[p + 1]);
        for (int k = start[p] + 1; k < start[p + 1]; k++)
            if (half[k][0] == half[k - 1][0] && half[k][1] == half[k - 1][1]) {
                beyond[half[k][2]] = half[k - 1][2] / 4;
                beyond[half[k - 1][2]] = half[k][2] / 4;
            }
    }
}

void SlitParts::mark_passed() {
    std::vector<uint8_t> lowest(slit.support.size()); // of a face that was passed: the search among all of them is slow
    for (const auto& [points, normal] : slit.cut) lowest[points[0]] = 1;
    for (int face = 0; face < int(beyond.size()); face++) {
        const auto& corner = slit.corner[face / 4];
        if (beyond[face] < 0 || std::none_of(corner.begin(), corner.end(), [&](int p) { return lowest[p]; })) continue;
        SlitComplex::Face points;
        for (int k = 0; k < 3; k++) points[k] = corner[tet_face[face % 4][k]];
        std::sort(points.begin(), points.end());
        const auto found = slit.cut.find(points);
        if (found == slit.cut.end()) continue;
        double inwards = 0;
        for (int d = 0; d < 3; d++) {
            double middle = 0;
            for (int p : corner) middle += slit.place[3 * size_t(p) + d] / 4;
            inwards += (middle - slit.place[3 * size_t(points[0]) + d]) * found->second[d];
        }
        passed[face] = 1;
        above[face] = inwards > 0 ? 1 : -1;
    }
}

void SlitParts::group() {
    DisjointSets within(count()), whole(count());
    for (int face = 0; face < int(beyond.size()); face++) {
        if (!bonded(face) || beyond[face] < face / 4) continue;
        whole.join(face / 4, beyond[face]);
        if (slit.parent[face / 4] == slit.parent[beyond[face]]) within.join(face / 4, beyond[face]);
    }
    const int fragments = within.number(fragment);
    whole.number(body);
    owner.assign(fragments, -1);
    fragment_of.assign(fragments, -1);
    share.assign(fragments, 0);
    for (int i = 0; i < count(); i++) {
        share[fragment[i]] += volume[i];
        if (owner[fragment[i]] < 0) owner[fragment[i]] = slit.parent[i], fragment_of[fragment[i]] = i;
    }
    std::vector<double> of_owner(*std::max_element(owner.begin(), owner.end()) + 1);
    for (int f = 0; f < fragments; f++) of_owner[owner[f]] += share[f];
    for (int f = 0; f < fragments; f++) share[f] /= of_owner[owner[f]];
}

// A body of crumbs alone is stuck on again, to one fragment beside it: to no more, since it may lie between the two
// lips of a cut, which it would join. Whether there was one.
bool SlitParts::stick_crumbs() {
    const int bodies = *std::max_element(body.begin(), body.end()) + 1;
    std::vector<uint8_t> holds(bodies);
    for (int i = 0; i < count(); i++) holds[body[i]] |= share[fragment[i]] >= least_share;
    std::vector<int> across(bodies, -1); // of each such body, the face to stick over: of a larger body, the widest
    const auto better = [&](int face, int than) {
        const bool larger = holds[body[beyond[face]]];
        if (than < 0 || larger != holds[body[beyond[than]]]) return than < 0 || larger;
        return area(face) > area(than);
    };
    for (int face = 0; face < int(beyond.size()); face++) {
        const int b = body[face / 4];
        if (passed[face] && !holds[b] && body[beyond[face]] != b && better(face, across[b])) across[b] = face;
    }
    const auto stick = [&](int crumb, int other) {
        const int b = body[crumb];
        return !holds[b] && across[b] >= 0 && (body[other] == b || fragment[other] == fragment[beyond[across[b]]]);
    };
    bool stuck = false;
    for (int face = 0; face < int(beyond.size()); face++)
        if (passed[face] && (stick(face / 4, beyond[face]) || stick(beyond[face], face / 4)))
            passed[face] = 0, stuck = true;
    return stuck;
}

double SlitParts::area(int face) const {
    const auto& corner = slit.corner[face / 4];
    double side[2][3], normal[3];
    for (int k = 0; k < 2; k++)
        for (int d = 0; d < 3; d++)
            side[k][d] = slit.place[3 * size_t(corner[tet_face[face % 4][k + 1]]) + d] -
                         slit.place[3 * size_t(corner[tet_face[face % 4][0]]) + d];
    cross(side[0], side[1], normal);
    return length(normal) / 2;
}

std::vector<int> SlitParts::vertices() const {
    DisjointSets same(4 * count());
    for (int face = 0; face < int(beyond.size()); face++) {
        const int i = face / 4, j = beyond[face];
        if (bonded(face) && i < j)
            common_corners(slit.corner[i], slit.corner[j], i, j, [&](int a, int b) { same.join(a, b); });
    }
    std::vector<int> out;
    same.number(out);
    return out;
}

} // namespace palpate
