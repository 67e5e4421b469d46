#include "cutting/virtual_nodes.h"
#include "cutting/disjoint_sets.h"
#include <algorithm>
#include <tuple>

namespace palpate {
namespace {

using Corners = std::array<int, 4>;

// Corners of the copies of all fragments; equal numbers are one node.
std::vector<Corners> shared_nodes(const SlitParts& parts, const std::vector<Corners>& tet) {
    DisjointSets same(4 * int(tet.size()));
    for (int face = 0; face < int(parts.beyond.size()); face++) {
        const int i = face / 4, j = parts.beyond[face];
        if (!parts.bonded(face) || j < i) continue;
        const int f = parts.fragment[i], g = parts.fragment[j];
        if (parts.owner[f] != parts.owner[g])
            SlitParts::common_corners(tet[f], tet[g], f, g, [&](int a, int b) { same.join(a, b); });
    }
    std::vector<int> number;
    same.number(number);
    std::vector<Corners> out(tet.size());
    for (size_t f = 0; f < tet.size(); f++) std::copy_n(&number[4 * f], 4, out[f].begin());
    return out;
}

// Fragments with the same nodes are one element: the copy of each fragment, numbered by owner and nodes, and how many.
int numbered_copies(const SlitParts& parts, const std::vector<Corners>& node, std::vector<int>& copy) {
    std::vector<int> order(node.size());
    std::iota(order.begin(), order.end(), 0);
    const auto key = [&](int f) { return std::tie(parts.owner[f], node[f]); };
    std::sort(order.begin(), order.end(), [&](int f, int g) { return key(f) < key(g); });
    copy.resize(node.size());
    int count = 0;
    for (size_t k = 0; k < order.size(); k++)
        copy[order[k]] = k > 0 && key(order[k]) == key(order[k - 1]) ? count - 1 : count++;
    return count;
}

// New numbers for `node`, compact: for each node of the mesh first a copy that is real, and of these that with the most
// volume, in the mesh's order; then the others. original, real: (tets, 4).
void renumber(VirtualNodes& made, const std::vector<int>& original, const std::vector<uint8_t>& real,
              const std::vector<double>& volume) {
    std::vector<int> used;
    for (const Corners& tet : made.tet) used.insert(used.end(), tet.begin(), tet.end());
    const std::vector<int> corner = used;
    std::sort(used.begin(), used.end());
    used.erase(std::unique(used.begin(), used.end()), used.end());
    std::vector<int> at(used.back() + 1), origin(used.size());
    for (size_t k = 0; k < used.size(); k++) at[used[k]] = int(k);
    std::vector<double> weight(used.size());
    std::vector<uint8_t> inside(used.size());
    for (size_t k = 0; k < corner.size(); k++) {
        weight[at[corner[k]]] += volume[k / 4];
        inside[at[corner[k]]] |= real[k];
        origin[at[corner[k]]] = original[k];
    }
    std::vector<int> order(used.size()), leading, others;
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
        return origin[a] != origin[b]   ? origin[a] < origin[b]
               : inside[a] != inside[b] ? inside[a] > inside[b]
                                        : weight[a] > weight[b];
    });
    for (size_t k = 0; k < order.size(); k++)
        (k == 0 || origin[order[k]] != origin[order[k - 1]] ? leading : others).push_back(order[k]);
    leading.insert(leading.end(), others.begin(), others.end());
    std::vector<int> number(used.size());
    for (size_t k = 0; k < leading.size(); k++) {
        number[leading[k]] = int(k);
        made.origin.push_back(origin[leading[k]]);
        made.real.push_back(inside[leading[k]]);
    }
    for (Corners& tet : made.tet)
        for (int& node : tet) node = number[at[node]];
}

// A fragment too small to have an element of its own gets that of a neighbour.
void find_hosts(const SlitParts& parts, std::vector<int>& element) {
    std::vector<std::array<int, 2>> bonds; // of fragments, one of which has none
    for (int face = 0; face < int(parts.beyond.size()); face++) {
        if (!parts.bonded(face)) continue;
        const int f = parts.fragment[face / 4], g = parts.fragment[parts.beyond[face]];
        if (element[f] < 0) bonds.push_back({f, g});
    }
    for (bool found = true; found;) {
        found = false;
        const std::vector<int> before = element;
        for (const auto& [f, g] : bonds)
            if (element[f] < 0 && before[g] >= 0) element[f] = before[g], found = true;
    }
}

} // namespace

VirtualNodes virtual_nodes(const SlitParts& parts, const int32_t* tets) {
    const int fragments = int(parts.owner.size());
    std::vector<Corners> tet(fragments);
    for (int f = 0; f < fragments; f++) std::copy_n(tets + 4 * size_t(parts.owner[f]), 4, tet[f].begin());
    const std::vector<Corners> node = shared_nodes(parts, tet);
    std::vector<int> copy;
    const int count = numbered_copies(parts, node, copy);

    std::vector<double> share(count), whole(*std::max_element(parts.owner.begin(), parts.owner.end()) + 1);
    std::vector<int> one(count, -1), side(count), largest(whole.size(), -1);
    for (int f = 0; f < fragments; f++) {
        share[copy[f]] += parts.share[f];
        if (one[copy[f]] < 0) one[copy[f]] = f;
    }
    for (int i = 0; i < parts.count(); i++) {
        whole[parts.slit.parent[i]] += parts.volume[i];
        for (int face = 4 * i; face < 4 * i + 4; face++)
            if (parts.passed[face]) side[copy[parts.fragment[i]]] += parts.above[face];
    }
    for (int c = 0; c < count; c++) {
        int& most = largest[parts.owner[one[c]]];
        if (most < 0 || share[c] >= share[most]) most = c;
    }
    const auto kept = [&](int c) { return share[c] >= least_share || largest[parts.owner[one[c]]] == c; };
    std::vector<std::array<uint8_t, 4>> inside(count); // of each copy, its corners that are corners of its parts
    for (int i = 0; i < parts.count(); i++)
        for (int k = 0; k < 4; k++) {
            const int f = parts.fragment[i];
            for (int p : parts.slit.corner[i]) inside[copy[f]][k] |= p == tet[f][k]; // the first points are the nodes
        }
    std::vector<int> number(count, -1), bodies, original;
    std::vector<uint8_t> real;
    std::vector<double> volume;
    VirtualNodes made;
    for (int c = 0; c < count; c++)
        if (!kept(c)) share[largest[parts.owner[one[c]]]] += share[c];
    for (int c = 0; c < count; c++) {
        if (!kept(c)) continue;
        const int f = one[c], owner = parts.owner[f];
        number[c] = int(made.tet.size());
        made.tet.push_back(node[f]);
        made.parent.push_back(owner);
        made.share.push_back(share[c]);
        made.side.push_back(int8_t((side[c] > 0) - (side[c] < 0)));
        bodies.push_back(parts.body[parts.fragment_of[f]]);
        original.insert(original.end(), tet[f].begin(), tet[f].end());
        real.insert(real.end(), inside[c].begin(), inside[c].end());
        volume.push_back(share[c] * whole[owner]);
    }
    renumber(made, original, real, volume);
    made.body = bodies;
    std::sort(bodies.begin(), bodies.end());
    bodies.erase(std::unique(bodies.begin(), bodies.end()), bodies.end());
    for (int& body : made.body) body = int(std::lower_bound(bodies.begin(), bodies.end(), body) - bodies.begin());
    for (int f = 0; f < fragments; f++) made.element.push_back(number[copy[f]]);
    find_hosts(parts, made.element);
    return made;
}

} // namespace palpate
