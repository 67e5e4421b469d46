// Groups of numbers that belong together, by union-find with path halving (R. E. Tarjan & J. van Leeuwen, J. ACM 31
// (1984) 245).
#pragma once
#include <numeric>
#include <utility>
#include <vector>

namespace palpate {

class DisjointSets {
public:
    explicit DisjointSets(int count) : parent(count) { std::iota(parent.begin(), parent.end(), 0); }

    // The least number of a group.
    int first(int i) {
        while (parent[i] != i) i = parent[i] = parent[parent[i]];
        return i;
    }
    void join(int a, int b) {
        a = first(a), b = first(b);
        if (a > b) std::swap(a, b);
        parent[b] = a; // never the other way: a group is named by its least number
    }
    // The groups, numbered in the order of their first numbers; out: the group of each number. Returns how many.
    int number(std::vector<int>& out) {
        int groups = 0;
        out.resize(parent.size());
        for (int i = 0; i < int(parent.size()); i++) out[i] = first(i) == i ? groups++ : out[first(i)];
        return groups;
    }

private:
    std::vector<int> parent;
};

} // namespace palpate
