#pragma once
#include "cholesky.h"
#include <cmath>

namespace palpate {

// What Green's functions need of a tissue, once and for all.
struct Elastic {
    const Cholesky* factor;       // of the stiffness among the free nodes
    FactorValues<float> single;   // the same, rounded: columns err by 1e-5 of themselves or less
    std::vector<int> free;        // (nodes) a node's number among the free ones, or -1 where it is held
    std::vector<int> vertex;      // (nodes) a node's number among the vertices, or -1
    std::vector<int> node, place; // (vertices) free nodes that are touched or shown: their node, and their free number
    std::vector<double> position; // (vertices, 3) mm, at rest
    int vertices() const { return int(node.size()); }
    int nodes() const { return int(free.size()); }
    double apart(int a, int b) const { // mm
        const double *p = &position[3 * size_t(a)], *q = &position[3 * size_t(b)];
        return std::sqrt((p[0] - q[0]) * (p[0] - q[0]) + (p[1] - q[1]) * (p[1] - q[1]) + (p[2] - q[2]) * (p[2] - q[2]));
    }
};

} // namespace palpate
