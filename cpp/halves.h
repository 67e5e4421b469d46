#pragma once
#include "elastic.h"
#include "substitution.h"
#include <memory>

namespace palpate {

// Half the way to a Green's function: the columns y = L^-1 e of unit forces on a vertex, of K = L L'. They are zero but
// on the vertex's path to the root of the elimination tree, and the compliance between two vertices is the product of
// theirs, G_ij = y_i' y_j, over what the paths share. So neighbours whose halves are there get their blocks without the
// way up through the tree, which visits more of it than the way down. By one thread.
class Halves {
public:
    explicit Halves(const Elastic& elastic);

    static constexpr int batch = 8; // vertices that are solved for together: 24 columns

    void make(const int* vertices, int count); // at most `batch`
    bool kept(int vertex) const { return bool(half[vertex]); }
    void drop(int vertex);
    // G between two whose halves are kept: displacement of i, force on j, row by row along i. The bits of (i, j) are
    // those of (j, i).
    void block(int i, int j, float out[9]) const;
    size_t bytes() const { return held; }

private:
    const Elastic& elastic;
    const Supernodes& tree;
    Substitution<float> substitution;
    std::vector<std::unique_ptr<float[]>> half; // (vertices) (3, rows of its path), from the leaf to the root
    std::vector<int64_t> rows;                  // (supernodes) of the path from it to the root
    std::vector<int> path, spots;
    std::vector<uint8_t> mark;
    size_t held = 0;
    int leaf(int vertex) const { return tree.part[tree.place[elastic.place[vertex]]]; }
};

} // namespace palpate
