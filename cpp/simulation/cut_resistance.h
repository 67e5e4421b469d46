// What holds a blade back in a tissue: the toughness along its edge, by exact integrals over the tetrahedra of the body
// before all cuts. Does not change after construction, so any number of loops may ask it.
#pragma once
#include "tissue/box_tree.h"
#include <array>
#include <cstdint>
#include <vector>

namespace palpate {

class CutResistance {
public:
    // node: (nodes, 3) mm; tet: (count, 4); region: (count) labels; label: (regions) of the regions, and toughness:
    // (regions) J/m^2 of each. A region that is not among them has none.
    CutResistance(const double* node, const int32_t* tet, const int32_t* region, int count, const int32_t* label,
                  const double* toughness, int regions);

    struct Edge {
        double inside = 0;    // mm of it in the tissue
        double toughness = 0; // J/m^2 mm, the integral along these
    };
    // Of an edge from a point, as long as `way`, mm. Allocates nothing.
    Edge along(const double point[3], const double way[3]) const;

    const std::vector<int32_t> label;    // (regions)
    const std::vector<double> toughness; // (regions) J/m^2
    const double toughest;               // of these, or 0

private:
    struct Tet {
        std::array<std::array<double, 3>, 4> corner; // mm
        double toughness;
    };
    std::vector<Tet> tets;
    BoxTree tree;
    // mm, by which every edge is moved, so that none lies in a face that two tetrahedra share: both or neither might
    // count it.
    double aside[3];
};

} // namespace palpate
