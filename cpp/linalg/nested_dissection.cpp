#include "linalg/nested_dissection.h"
#include <algorithm>
#include <array>
#include <cmath>

namespace palpate {
namespace {

// Normals of the planes that are tried: along axes, and the diagonals of faces and of the cube. The nodes of a lattice
// lie in layers across them, and a plane between two layers leaves few edges.
constexpr int directions = 13;
constexpr int normals[directions][3] = {{1, 0, 0}, {0, 1, 0},  {0, 0, 1}, {1, 1, 0},  {1, -1, 0}, {1, 0, 1}, {1, 0, -1},
                                        {0, 1, 1}, {0, 1, -1}, {1, 1, 1}, {1, 1, -1}, {1, -1, 1}, {-1, 1, 1}};
// Of the nodes below a plane: along every normal, and then along that of the best one.
constexpr double first_shares[] = {0.42, 0.58}, more_shares[] = {0.5, 0.46, 0.54, 0.35, 0.65};

// A plane at `height`, and how far each node is along its normal: -infinity if it is not of the part that is cut.
struct Halves {
    const std::vector<double>& along;
    double height;
    bool above(int node) const { return along[node] >= height; }
};

// The edges between two halves, and the smallest set of nodes that touches them all.
class Cover {
public:
    explicit Cover(const SparsityPattern& pattern)
        : pattern(pattern), mate(pattern.nodes(), -1), seen(pattern.nodes(), 0) {}

    // near: all nodes below that may have an edge to one above. Appends the set to `out`; nothing if it would have more
    // than `most` nodes, which is known before the set is.
    bool smallest(const Halves& halves, const int* near, const int* end, double most, std::vector<int>& out) {
        edge_nodes.clear();
        for (const int* a = near; a < end; a++) {
            bool crosses = false;
            for (int k = pattern.start[*a]; k < pattern.start[*a + 1] && !crosses; k++)
                crosses = halves.above(pattern.column[k]);
            if (crosses) edge_nodes.push_back(*a);
        }
        int matched = 0; // the largest matching has as many edges as the smallest set has nodes
        for (int a : edge_nodes) matched += greedy(halves, a);
        const int lost = ++round; // marks what no augmenting path can leave, now or later
        reached.clear();
        for (int a : edge_nodes)
            if (mate[a] < 0 && matched <= most) {
                round++;
                matched += augment(halves, a, lost);
            }
        // Konig: the nodes below that alternating paths from unmatched ones miss, those above that they meet.
        for (int a : edge_nodes)
            if (seen[a] != lost && matched <= most) out.push_back(a);
        if (matched <= most) out.insert(out.end(), reached.begin(), reached.end());
        for (int a : edge_nodes) {
            if (mate[a] >= 0) mate[mate[a]] = -1;
            mate[a] = -1;
        }
        return matched <= most;
    }

private:
    const SparsityPattern& pattern;
    std::vector<int> mate, edge_nodes, reached, visited, stack, next;
    std::vector<int> seen;
    int round = 0;

    bool greedy(const Halves& halves, int a) {
        for (int k = pattern.start[a]; k < pattern.start[a + 1]; k++)
            if (int b = pattern.column[k]; mate[b] < 0 && halves.above(b)) {
                mate[a] = b, mate[b] = a;
                return true;
            }
        return false;
    }

    // An alternating path from the unmatched `root` to an unmatched node above, turned over where there is one. Where
    // there is none, what was visited can be left out of all later searches. Written with a stack of its own: a path
    // may be as long as the cut.
    bool augment(const Halves& halves, int root, int lost) {
        stack.assign(1, root), next.assign(1, pattern.start[root]);
        visited.assign(1, root);
        seen[root] = round;
        const size_t before = reached.size();
        while (!stack.empty()) {
            int a = stack.back();
            if (next.back() == pattern.start[a + 1]) {
                stack.pop_back(), next.pop_back();
                continue;
            }
            int b = pattern.column[next.back()++];
            if (seen[b] == round || seen[b] == lost || !halves.above(b)) continue;
            seen[b] = round;
            if (mate[b] >= 0) {
                seen[mate[b]] = round;
                visited.push_back(b), visited.push_back(mate[b]), reached.push_back(b);
                stack.push_back(mate[b]), next.push_back(pattern.start[mate[b]]);
                continue;
            }
            for (size_t i = stack.size(); i-- > 0;) {
                int behind = mate[stack[i]];
                mate[stack[i]] = b, mate[b] = stack[i];
                b = behind;
            }
            reached.resize(before);
            return true;
        }
        for (int node : visited) seen[node] = lost;
        return false;
    }
};

class Cutter {
public:
    using Sorted = std::array<std::vector<int>, directions>; // the nodes of a part, along each normal

    Cutter(const SparsityPattern& pattern, const double* places, int leaf)
        : leaf(leaf), in_part(pattern.nodes(), -HUGE_VAL), side(pattern.nodes()), cover(pattern) {
        Sorted all;
        std::vector<std::pair<double, int>> order(pattern.nodes());
        for (int d = 0; d < directions; d++) {
            along[d].resize(pattern.nodes());
            for (int i = 0; i < pattern.nodes(); i++) {
                for (int k = 0; k < 3; k++) along[d][i] += normals[d][k] * places[3 * size_t(i) + k];
                order[i] = {along[d][i], i};
            }
            std::sort(order.begin(), order.end());
            for (const auto& [height, i] : order) all[d].push_back(i);
            for (int i = 0; i < pattern.nodes(); i++)
                for (int k = pattern.start[i]; k < pattern.start[i + 1]; k++)
                    longest[d] = std::max(longest[d], along[d][pattern.column[k]] - along[d][i]);
        }
        cut(std::move(all));
        result.first.push_back(pattern.nodes());
    }

    Dissection result;

private:
    const int leaf;
    std::array<std::vector<double>, directions> along; // of all nodes, each normal
    std::array<double, directions> longest{};          // edge along it
    std::vector<double> in_part;                       // along the normal at hand, of the nodes at hand
    std::vector<int8_t> side;                          // of these once they are cut: -1, 1, and 0 for the cut
    Cover cover;

    // A plane costs the nodes in the cut, times the root of those in the larger half.
    void cut(Sorted nodes) {
        const int size = int(nodes[0].size());
        std::vector<int> best, trial;
        double least = HUGE_VAL, height = 0;
        int normal = 0;
        const auto attempt = [&](int d, double share) {
            const int *begin = nodes[d].data(), *end = begin + size;
            const auto lower = [&](double h) {
                return std::partition_point(begin, end, [&](int i) { return along[d][i] < h; });
            };
            const double at = along[d][begin[int(share * size)]];
            const int* middle = lower(at);
            if (middle == begin) return;
            trial.clear();
            const double larger = std::sqrt(double(std::max(middle - begin, end - middle)));
            if (!cover.smallest({in_part, at}, lower(at - longest[d]), middle, least / larger, trial)) return;
            const double cost = double(trial.size()) * larger;
            if (cost < least) best.swap(trial), least = cost, normal = d, height = at;
        };
        const auto look_along = [&](int d) {
            for (int i : nodes[d]) in_part[i] = along[d][i];
        };
        for (int d = 0; d < directions && size > leaf; d++) {
            look_along(d);
            for (double share : first_shares) attempt(d, share);
        }
        if (least < HUGE_VAL) {
            const int chosen = normal;
            look_along(chosen);
            for (double share : more_shares) attempt(chosen, share);
        }
        for (int i : nodes[0]) in_part[i] = -HUGE_VAL;
        if (least == HUGE_VAL) { // few nodes, or all in one place
            std::sort(nodes[0].begin(), nodes[0].end());
            return finish(nodes[0]);
        }
        for (int i : nodes[0]) side[i] = along[normal][i] < height ? -1 : 1;
        for (int i : best) side[i] = 0;
        Sorted lower, upper;
        for (int d = 0; d < directions; d++) {
            for (int i : nodes[d])
                if (side[i] != 0) (side[i] < 0 ? lower : upper)[d].push_back(i);
            nodes[d] = {};
        }
        if (!lower[0].empty()) cut(std::move(lower));
        if (!upper[0].empty()) cut(std::move(upper));
        std::sort(best.begin(), best.end());
        finish(best);
    }

    void finish(const std::vector<int>& nodes) {
        if (nodes.empty()) return;
        result.first.push_back(int(result.order.size()));
        result.order.insert(result.order.end(), nodes.begin(), nodes.end());
    }
};

} // namespace

Dissection dissect(const SparsityPattern& pattern, const double* places, int leaf) {
    return std::move(Cutter(pattern, places, leaf).result);
}

} // namespace palpate
