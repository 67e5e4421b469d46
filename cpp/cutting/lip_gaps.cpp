#include "cutting/lip_gaps.h"
#include "base/vec3.h"
#include "cutting/disjoint_sets.h"
#include <algorithm>
#include <cmath>
#include <map>

namespace palpate {
namespace {

constexpr double kink = 0.1; // standard deviation of the normals about their mean, from which on a part counts as two
constexpr double at_mean = 1e-6; // of a normal that is the mean but for rounding: it stays on the first side
constexpr int kinks = 2;         // rounds of halving: up to three kinks at a node

using Vector = std::array<double, 3>;

// A corner of a face of the cut: the vertex of one lip, that of the other at the same place, and a third of the face's
// area times its normal, out of the first.
struct Corner {
    int front, back;
    Vector normal;
};

// A corner's share in a gap.
struct Share {
    int corner, gap;
    double part;     // of the shape function there
    double sign;     // 1 if `front` is on the lip that is the gap's first, else -1
    Vector outwards; // part times the normal, out of the gap's first lip
};

std::vector<int> numbered_places(const EmbeddedSkin& skin, double same) {
    std::vector<int> order;
    for (int t = 0; t < skin.triangles; t++)
        if (skin.lip[t]) order.insert(order.end(), skin.triangle + 3 * size_t(t), skin.triangle + 3 * size_t(t) + 3);
    std::sort(order.begin(), order.end());
    order.erase(std::unique(order.begin(), order.end()), order.end());
    const auto at = [&](int v) { return skin.place + 3 * size_t(v); };
    std::vector<std::pair<double, int>> along; // a direction that lies in no plane of a cut
    for (int v : order) along.emplace_back(0.36 * at(v)[0] + 0.48 * at(v)[1] + 0.8 * at(v)[2], v);
    std::sort(along.begin(), along.end());
    DisjointSets groups(skin.vertices);
    for (size_t i = 0; i < along.size(); i++)
        for (size_t j = i + 1; j < along.size() && along[j].first - along[i].first <= same; j++)
            if (distance(at(along[i].second), at(along[j].second)) <= same)
                groups.join(along[i].second, along[j].second);
    std::vector<int> out;
    groups.number(out);
    return out;
}

// The corners of faces that two lips have at one place.
std::vector<Corner> opposite_corners(const EmbeddedSkin& skin, double same) {
    const std::vector<int> place = numbered_places(skin, same);
    std::map<std::array<int, 3>, std::vector<int>> faces; // triangles of lips by their places
    for (int t = 0; t < skin.triangles; t++) {
        if (!skin.lip[t]) continue;
        std::array<int, 3> at;
        for (int k = 0; k < 3; k++) at[k] = place[skin.triangle[3 * size_t(t) + k]];
        std::sort(at.begin(), at.end());
        faces[at].push_back(t);
    }
    std::vector<Corner> out;
    for (const auto& [at, found] : faces) {
        if (found.size() != 2) continue;
        const int32_t *front = skin.triangle + 3 * size_t(found[0]), *back = skin.triangle + 3 * size_t(found[1]);
        const double *a = skin.place + 3 * size_t(front[0]), *b = skin.place + 3 * size_t(front[1]),
                     *c = skin.place + 3 * size_t(front[2]);
        double u[3], w[3];
        for (int d = 0; d < 3; d++) u[d] = b[d] - a[d], w[d] = c[d] - a[d];
        const Vector third{(u[1] * w[2] - u[2] * w[1]) / 6, (u[2] * w[0] - u[0] * w[2]) / 6,
                           (u[0] * w[1] - u[1] * w[0]) / 6};
        for (int k = 0; k < 3; k++) {
            const int32_t* other = std::find_if(back, back + 3, [&](int v) { return place[v] == place[front[k]]; });
            if (other < back + 3) out.push_back({front[k], *other, third});
        }
    }
    return out;
}

// New numbers without gaps between them, in the same order.
void renumber(std::vector<Share>& shares) {
    std::vector<int> used;
    for (const Share& one : shares) used.push_back(one.gap);
    std::sort(used.begin(), used.end());
    used.erase(std::unique(used.begin(), used.end()), used.end());
    for (Share& one : shares) one.gap = int(std::lower_bound(used.begin(), used.end(), one.gap) - used.begin());
}

// The copies of one node that move a front corner and the back corner opposite have a gap.
std::vector<Share> shares_of(const EmbeddedSkin& skin, const std::vector<Corner>& corners) {
    std::map<std::array<int, 2>, int> pairs;
    std::vector<std::array<int, 2>> pair;
    std::vector<Share> out;
    for (int c = 0; c < int(corners.size()); c++) {
        const size_t front = 4 * size_t(corners[c].front), back = 4 * size_t(corners[c].back);
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) {
                const int a = skin.carrier[front + i], b = skin.carrier[back + j];
                if (a == b || skin.origin[a] != skin.origin[b]) continue; // at the blade's tip they are one
                if (!(skin.weight[front + i] > 0 && skin.weight[back + j] > 0)) continue;
                const double part = skin.weight[front + i];
                const double sign = a < b ? 1 : -1;
                Vector outwards = corners[c].normal;
                for (double& v : outwards) v *= sign * part;
                pair.push_back({std::min(a, b), std::max(a, b)});
                pairs[pair.back()] = 0;
                out.push_back({c, 0, part, sign, outwards});
            }
    }
    int next = 0;
    for (auto& [nodes, number] : pairs) number = next++;
    for (size_t k = 0; k < out.size(); k++) out[k].gap = pairs[pair[k]];
    return out;
}

// The largest eigenvalue of a symmetric matrix and its vector, by Jacobi's rotations.
double principal(double A[3][3], Vector& out) {
    double V[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int sweep = 0; sweep < 20; sweep++)
        for (int p = 0; p < 2; p++)
            for (int q = p + 1; q < 3; q++) {
                if (A[p][q] == 0) continue;
                const double tau = (A[q][q] - A[p][p]) / (2 * A[p][q]);
                const double t = (tau < 0 ? -1 : 1) / (std::abs(tau) + std::sqrt(1 + tau * tau));
                const double c = 1 / std::sqrt(1 + t * t), s = t * c;
                for (int k = 0; k < 3; k++) {
                    const double x = A[k][p], y = A[k][q];
                    A[k][p] = c * x - s * y, A[k][q] = s * x + c * y;
                }
                for (int k = 0; k < 3; k++) {
                    const double x = A[p][k], y = A[q][k], v = V[k][p], w = V[k][q];
                    A[p][k] = c * x - s * y, A[q][k] = s * x + c * y;
                    V[k][p] = c * v - s * w, V[k][q] = s * v + c * w;
                }
            }
    int most = 0;
    for (int k = 1; k < 3; k++)
        if (A[k][k] > A[most][most]) most = k;
    out = {V[0][most], V[1][most], V[2][most]};
    const double largest =
        *std::max_element(out.begin(), out.end(), [](double a, double b) { return std::abs(a) < std::abs(b); });
    for (double& v : out) v *= largest < 0 ? -1 : 1; // of both, always the same one
    return A[most][most];
}

// A gap whose normals lie about a kink becomes one on either side of it.
void halve_at_kinks(std::vector<Share>& shares) {
    const int gaps = shares.empty() ? 0 : 1 + std::max_element(shares.begin(), shares.end(), [](auto& a, auto& b) {
                                                  return a.gap < b.gap;
                                              })->gap;
    std::vector<double> size(gaps);
    std::vector<Vector> mean(gaps), off(shares.size());
    for (const Share& one : shares) {
        size[one.gap] += length(one.outwards.data());
        for (int d = 0; d < 3; d++) mean[one.gap][d] += one.outwards[d];
    }
    std::vector<std::array<double, 9>> spread(gaps);
    for (size_t k = 0; k < shares.size(); k++) {
        const Share& one = shares[k];
        const double area = length(one.outwards.data());
        for (int d = 0; d < 3; d++)
            off[k][d] = one.outwards[d] / std::max(area, 1e-300) - mean[one.gap][d] / size[one.gap];
        for (int e = 0; e < 9; e++) spread[one.gap][e] += area * off[k][e / 3] * off[k][e % 3] / size[one.gap];
    }
    std::vector<Vector> across(gaps);
    std::vector<uint8_t> turns(gaps);
    for (int g = 0; g < gaps; g++) {
        double A[3][3];
        for (int e = 0; e < 9; e++) A[e / 3][e % 3] = spread[g][e];
        turns[g] = principal(A, across[g]) > kink * kink;
    }
    for (size_t k = 0; k < shares.size(); k++) {
        int& gap = shares[k].gap;
        gap = 2 * gap + (turns[gap] && dot(off[k].data(), across[gap].data()) > at_mean);
    }
    renumber(shares);
}

// Two units at right angles to a normal, which need not be one, and to each other.
std::array<double, 6> along(const Vector& normal) {
    Vector n = normal;
    const double size = std::max(length(n.data()), 1e-300);
    for (double& v : n) v /= size;
    int least = 0;
    for (int k = 1; k < 3; k++)
        if (std::abs(n[k]) < std::abs(n[least])) least = k;
    const int i = (least + 1) % 3, j = (least + 2) % 3;
    Vector first{};
    first[i] = n[j], first[j] = -n[i]; // n times the axis
    const double across = length(first.data());
    for (double& v : first) v /= across;
    return {first[0],
            first[1],
            first[2],
            n[1] * first[2] - n[2] * first[1],
            n[2] * first[0] - n[0] * first[2],
            n[0] * first[1] - n[1] * first[0]};
}

} // namespace

LipGaps lip_gaps(const EmbeddedSkin& skin, double same) {
    const std::vector<Corner> corners = opposite_corners(skin, same);
    std::vector<Share> shares = shares_of(skin, corners);
    for (int round = 0; round < kinks; round++) halve_at_kinks(shares);
    int gaps = 0;
    for (const Share& one : shares) gaps = std::max(gaps, one.gap + 1);
    std::vector<double> size(gaps);
    std::vector<Vector> mean(gaps); // times the area
    for (const Share& one : shares) {
        size[one.gap] += length(one.outwards.data());
        for (int d = 0; d < 3; d++) mean[one.gap][d] += one.outwards[d];
    }

    std::vector<std::map<int, std::array<double, 9>>> entries(gaps); // by node: normal, then two tangents
    for (const Share& one : shares) {
        const Corner& corner = corners[one.corner];
        const std::array<double, 6> ways = along(mean[one.gap]);
        const double of_area = length(one.outwards.data()) / size[one.gap];
        for (int lip = 0; lip < 2; lip++) // the jump from the gap's first lip to its second
            for (int k = 0; k < 4; k++) {
                const size_t at = 4 * size_t(lip ? corner.back : corner.front) + k;
                const double by = one.sign * (lip ? skin.weight[at] : -skin.weight[at]);
                auto& entry = entries[one.gap][skin.carrier[at]];
                for (int d = 0; d < 3; d++) entry[d] += by * one.outwards[d] / size[one.gap];
                for (int d = 0; d < 6; d++) entry[3 + d] += by * of_area * ways[d];
            }
    }
    LipGaps out;
    out.first.push_back(0);
    for (const auto& of_gap : entries) {
        for (const auto& [node, values] : of_gap) {
            out.node.push_back(node);
            out.normal.push_back({values[0], values[1], values[2]});
            out.tangent.emplace_back();
            std::copy_n(values.begin() + 3, 6, out.tangent.back().begin());
        }
        out.first.push_back(int(out.node.size()));
    }
    return out;
}

} // namespace palpate
