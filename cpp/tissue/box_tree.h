// A tree of axis-aligned boxes over triangles or tetrahedra: split at the median of the longest side, at most four of
// them in a leaf.
#pragma once
#include <vector>

namespace palpate {

// A box, mm.
struct Bounds {
    double low[3] = {1e300, 1e300, 1e300}, high[3] = {-1e300, -1e300, -1e300};
    void add(const double point[3]) {
        for (int k = 0; k < 3; k++) {
            low[k] = point[k] < low[k] ? point[k] : low[k];
            high[k] = point[k] > high[k] ? point[k] : high[k];
        }
    }
};

struct BoxTree {
    static constexpr int deepest = 64; // boxes on the way from the root to a leaf, at most

    // Boxes; of an inner one the left child comes next.
    struct Box : Bounds {
        int first = 0,
            count = 0; // leaf: order[first .. first + count]; else count = 0 and first = the right child
    };
    std::vector<Box> box;
    std::vector<int> order; // of what the leaves hold

    // bounds: of each of what the tree holds. centre: (.., 3) mm, by which it is split, up to a factor.
    void build(const std::vector<Bounds>& bounds, const std::vector<double>& centre);

private:
    int build(const std::vector<Bounds>& bounds, const std::vector<double>& centre, int first, int count);
};

} // namespace palpate
