#include "linalg/nested_dissection.h"
#include <algorithm>

namespace palpate {
namespace {

// The edges between two halves, and the smallest set of nodes that touches them all.
class Cover {
public:
    Cover(const SparsityPattern& pattern, std::vector<int8_t>& side)
        : pattern(pattern), side(side), mate(pattern.nodes(), -1) {
        seen.assign(pattern.nodes(), 0);
    }

    // Of the edges from nodes of side 1 to nodes of side 2; appends to `out`.
    void smallest(const std::vector<int>& low, std::vector<int>& out) {
        edge_nodes.clear();
        for (int a : low) {
            bool crosses = false;
            for (int k = pattern.start[a]; k < pattern.start[a + 1] && !crosses; k++)
                crosses = side[pattern.column[k]] == 2;
            if (crosses) edge_nodes.push_back(a);
        }
        for (int a : edge_nodes) greedy(a);
        for (int a : edge_nodes)
            if (mate[a] < 0) {
                round++;
                augment(a);
            }
        round++;
        reached.clear();
        for (int a : edge_nodes)
            if (mate[a] < 0) reach(a);
        // Konig: the nodes of side 1 that alternating paths from unmatched ones miss, those of side 2 that they meet.
        for (int a : edge_nodes)
            if (seen[a] != round) out.push_back(a);
        out.insert(out.end(), reached.begin(), reached.end());
        for (int a : edge_nodes) {
            if (mate[a] >= 0) mate[mate[a]] = -1;
            mate[a] = -1;
        }
    }

private:
    const SparsityPattern& pattern;
    const std::vector<int8_t>& side;
    std::vector<int> mate, edge_nodes, reached, stack, next;
    std::vector<int> seen;
    int round = 0;

    void greedy(int a) {
        for (int k = pattern.start[a]; k < pattern.start[a + 1]; k++)
            if (int b = pattern.column[k]; side[b] == 2 && mate[b] < 0) {
                mate[a] = b, mate[b] = a;
                return;
            }
    }

    // An alternating path from the unmatched `a` to an unmatched node of side 2, turned over where there is one.
    // Written with a stack of its own: a path may be as long as the cut.
    bool augment(int root) {
        stack.assign(1, root), next.assign(1, pattern.start[root]);
        seen[root] = round;
        while (!stack.empty()) {
            int a = stack.back();
            if (next.back() == pattern.start[a + 1]) {
                stack.pop_back(), next.pop_back();
                continue;
            }
            int b = pattern.column[next.back()++];
            if (side[b] != 2 || seen[b] == round) continue;
            seen[b] = round;
            if (mate[b] >= 0) {
                if (seen[mate[b]] != round) {
                    seen[mate[b]] = round;
                    stack.push_back(mate[b]), next.push_back(pattern.start[mate[b]]);
                }
                continue;
            }
            for (size_t i = stack.size(); i-- > 0;) {
                int behind = mate[stack[i]];
                mate[stack[i]] = b, mate[b] = stack[i];
                b = behind;
            }
            return true;
        }
        return false;
    }

    void reach(int root) {
        if (seen[root] == round) return;
        stack.assign(1, root);
        seen[root] = round;
        while (!stack.empty()) {
            int a = stack.back();
            stack.pop_back();
            for (int k = pattern.start[a]; k < pattern.start[a + 1]; k++) {
                int b = pattern.column[k];
                if (side[b] != 2 || seen[b] == round) continue;
                seen[b] = round;
                reached.push_back(b);
                if (seen[mate[b]] != round) seen[mate[b]] = round, stack.push_back(mate[b]);
            }
        }
    }
};

class Cutter {
public:
    Cutter(const SparsityPattern& pattern, const double* places, int leaf)
        : places(places), leaf(leaf), side(pattern.nodes(), 0), cover(pattern, side) {}

    void cut(std::vector<int> nodes) {
        if (int(nodes.size()) <= leaf) return finish(nodes);
        std::vector<int> best, trial;
        int best_axis = -1;
        for (int axis = 0; axis < 3; axis++) {
            const size_t low = halve(nodes, axis);
            if (low == 0) continue;
            trial.clear();
            cover.smallest({nodes.begin(), nodes.begin() + low}, trial);
            if (best_axis < 0 || trial.size() < best.size()) best.swap(trial), best_axis = axis;
        }
        if (best_axis < 0) { // all in one place
            for (int i : nodes) side[i] = 0;
            return finish(nodes);
        }
        halve(nodes, best_axis);
        for (int i : best) side[i] = 3;
        std::vector<int> half[2];
        for (int i : nodes)
            if (side[i] != 3) half[side[i] - 1].push_back(i);
        for (int i : nodes) side[i] = 0;
        if (half[0].empty() && half[1].empty()) return finish(nodes);
        nodes.clear(), nodes.shrink_to_fit();
        for (auto& part : half)
            if (!part.empty()) cut(std::move(part));
        std::sort(best.begin(), best.end());
        finish(best);
    }

    Dissection result;

private:
    const double* places;
    const int leaf;
    std::vector<int8_t> side; // 1, 2 of the nodes at hand while they are cut, 3 the cut, else 0
    Cover cover;

    // The nodes below the median of one coordinate first, marked 1, the others 2; how many are below.
    size_t halve(std::vector<int>& nodes, int axis) {
        auto at = [&](int i) { return places[3 * size_t(i) + axis]; };
        auto middle = nodes.begin() + nodes.size() / 2;
        std::nth_element(nodes.begin(), middle, nodes.end(), [&](int i, int j) { return at(i) < at(j); });
        const double median = at(*middle);
        auto end = std::partition(nodes.begin(), nodes.end(), [&](int i) { return at(i) < median; });
        std::sort(nodes.begin(), end), std::sort(end, nodes.end()); // the same result whatever the library's order
        for (int i : nodes) side[i] = at(i) < median ? 1 : 2;
        return end - nodes.begin();
    }

    void finish(const std::vector<int>& nodes) {
        if (nodes.empty()) return;
        result.first.push_back(int(result.order.size()));
        result.order.insert(result.order.end(), nodes.begin(), nodes.end());
    }
};

} // namespace

Dissection dissect(const SparsityPattern& pattern, const double* places, int leaf) {
    Cutter cutter(pattern, places, leaf);
    std::vector<int> all(pattern.nodes());
    for (int i = 0; i < pattern.nodes(); i++) all[i] = i;
    cutter.cut(std::move(all));
    cutter.result.first.push_back(pattern.nodes());
    return std::move(cutter.result);
}

} // namespace palpate
