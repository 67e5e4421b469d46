#include "compliance.h"
#include <algorithm>
#include <stdexcept>

// Which pairs of nodes a tick's patches need, and the blocks of each: kept from the tick before, fetched, or made.
namespace palpate {
namespace {

constexpr int capacity = Patch::capacity;

size_t row_of(int i) { return size_t(i) * (i + 1) / 2; } // of the pairs' blocks

// The vertices of patches together, rising, each once.
struct Nodes {
    int vertex[most_tools * capacity], of[most_tools * capacity], at[most_tools * capacity];
    int all = 0, distinct = 0; // of: patch and place there; at: of that in `vertex`
    bool gather(const Elastic& elastic, const Patch* patches, int count) { // false: too many
        for (int p = 0; p < count; p++)
            for (int k = 0; k < patches[p].count; k++) {
                const int v = elastic.vertex[patches[p].node[k]];
                if (v < 0) throw std::invalid_argument("patch: a node that is not a free vertex");
                int to = all++; // by insertion: patches are small, and stay nearly in order
                for (; to > 0 && vertex[to - 1] > v; to--) vertex[to] = vertex[to - 1], of[to] = of[to - 1];
                vertex[to] = v, of[to] = p * capacity + k;
            }
        for (int k = 0; k < all; k++) {
            if (k == 0 || vertex[k] != vertex[distinct - 1]) vertex[distinct++] = vertex[k];
            at[k] = distinct - 1;
        }
        return distinct <= capacity;
    }
};

// now: the pairs of these vertices, with the blocks that old ones have.
void keep_pairs(const ComplianceState::Pairs& old, ComplianceState::Pairs& now, const int* vertex, int count) {
    now.count = count;
    std::copy_n(vertex, count, now.vertex.begin());
    // Runs of nodes that stand together in both: their blocks move together.
    struct Run {
        int first, count, from;
    } runs[capacity];
    int kept = 0, next = 0;
    for (int i = 0; i < now.count; i++) {
        while (next < old.count && old.vertex[next] < vertex[i]) next++;
        if (next == old.count || old.vertex[next] != vertex[i]) continue;
        Run& last = runs[std::max(kept - 1, 0)];
        if (kept > 0 && last.first + last.count == i && last.from + last.count == next)
            last.count++;
        else
            runs[kept++] = {i, 1, next};
    }
    const size_t pairs = row_of(now.count);
    for (size_t k = 0; k < 9 * pairs; k += 16) __builtin_prefetch(&now.block[k], 1);
    std::fill_n(now.known.begin(), pairs, uint8_t(0));
    for (int r = 0; r < kept; r++)
        for (int k = 0; k < runs[r].count; k++)
            for (int q = 0; q <= r; q++) {
                const size_t to = row_of(runs[r].first + k) + runs[q].first;
                const size_t from = row_of(runs[r].from + k) + runs[q].from;
                const int some = q < r ? runs[q].count : k + 1;
                std::copy_n(&old.known[from], some, &now.known[to]);
                std::copy_n(&old.block[9 * from], 9 * some, &now.block[9 * to]);
            }
    now.lacking = int(std::count(now.known.begin(), now.known.begin() + pairs, uint8_t(0)));
    now.looked = -1;
}

} // namespace

// Takes over the patches, and the blocks of the pairs that they keep; false if they have too many nodes together.
bool Compliance::seat(ComplianceState& s, const Patch* patches, int count) const {
    Nodes nodes;
    if (!nodes.gather(elastic, patches, count)) return false;
    for (int p = 0; p < count; p++) std::fill_n(&s.weight[p * capacity], nodes.distinct, 0.0);
    for (int k = 0; k < nodes.all; k++) {
        const int p = nodes.of[k] / capacity;
        s.weight[p * capacity + nodes.at[k]] = patches[p].weight[nodes.of[k] % capacity];
    }
    if (s.pairs.of(nodes.vertex, nodes.distinct)) return true;
    if (!s.spare.of(nodes.vertex, nodes.distinct)) keep_pairs(s.pairs, s.spare, nodes.vertex, nodes.distinct);
    std::swap(s.pairs, s.spare);
    return true;
}

// Where a node enters a patch some twenty tables are read that no cache holds: sooner here than in the tick.
void Compliance::expect(State& state, const Patch* patches, int count) const {
    auto& s = static_cast<ComplianceState&>(state);
    Nodes nodes;
    if (!nodes.gather(elastic, patches, count) || s.pairs.of(nodes.vertex, nodes.distinct)) return;
    if (!s.spare.of(nodes.vertex, nodes.distinct)) keep_pairs(s.pairs, s.spare, nodes.vertex, nodes.distinct);
    fetch(s.green, s.spare);
}

// Takes over what has been made of the blocks that lack.
void Compliance::fetch(Green& green, ComplianceState::Pairs& pairs) const {
    const int64_t made = green.made_near;
    if (pairs.lacking == 0 || made == pairs.looked) return;
    pairs.looked = made;
    constexpr int some = 64; // at once, lest the stack spread over many pages
    Green::Wanted wanted[some];
    uint8_t* known[some];
    size_t pair = 0;
    int count = 0;
    auto look = [&] {
        green.find(wanted, count);
        for (int k = 0; k < count; k++)
            if (wanted[k].found) *known[k] = 1, pairs.lacking--;
        count = 0;
    };
    green.open();
    for (int i = 0; i < pairs.count; i++)
        for (int j = 0; j <= i; j++, pair++) {
            if (pairs.known[pair]) continue;
            known[count] = &pairs.known[pair];
            wanted[count++] = {pairs.vertex[i], pairs.vertex[j], &pairs.block[9 * pair], false};
            if (count == some) look();
        }
    look();
    green.close();
}

// In lockstep: the blocks of the patch's nodes that no other has made.
void Compliance::make_now(ComplianceState& s) const {
    const std::vector<int> vertices(s.pairs.vertex.begin(), s.pairs.vertex.begin() + s.pairs.count);
    double reach = 0;
    for (int v : vertices)
        for (int w : vertices) reach = std::max(reach, elastic.apart(v, w));
    s.green.use(vertices.data(), int(vertices.size()));
    std::vector<int> lacking;
    for (int v : vertices)
        if (!s.green.near_made(v, reach)) lacking.push_back(v);
    for (size_t k = 0; k < lacking.size(); k += Green::batch)
        s.green.make_near(&lacking[k], int(std::min<size_t>(Green::batch, lacking.size() - k)), 1.25 * reach);
    fetch(s.green, s.pairs);
}

} // namespace palpate
