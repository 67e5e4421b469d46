#pragma once
#include "buffer.h"
#include "supernodes.h"

namespace palpate {

// A symmetric matrix in 3x3 node blocks, by rows: block[9 k] for k in start[i] .. start[i + 1], both triangles.
struct BlockMatrix {
    Pattern pattern;
    const double* block;
};

// The factor's numbers. Supernode s has its own panels first (panel p: columns 0 .. 8p + 7 of 8 rows, whose last tile,
// on the diagonal, is kept inverted), then the panels below (all its columns), each column by column: a substitution
// reads straight through.
template <class T> using FactorValues = std::vector<T, CacheAligned<T>>;

// K = L L' of a symmetric positive definite matrix, by the multifrontal method (I. S. Duff & J. K. Reid, ACM Trans.
// Math. Softw. 9 (1983) 302): each supernode gathers its entries of K and its children's Schur complements in a dense
// front, eliminates its own columns, and hands the rest on. Subtrees and large fronts run on threads; every number is
// summed in an order that the tree alone decides, so the bits do not depend on their number.
class Cholesky {
public:
    Cholesky(const BlockMatrix& K, const double* places); // places: (nodes, 3) mm, to cut the nodes in halves

    const Supernodes tree;
    // Every pivot was positive. Then K + slack 1 is positive semidefinite: the factorisation's rounding errors are a
    // perturbation of norm at most gamma_{n+4} trace K (S. M. Rump, BIT 46 (2006) 433), which is `slack`.
    bool positive = true;
    double slack = 0;
    FactorValues<double> value; // empty unless positive
    FactorValues<float> rounded() const;

    // x becomes K^-1 x, the unknowns in the caller's order. x: (3 nodes, columns). Uses threads over the columns.
    void solve(double* x, int columns) const;
};

} // namespace palpate
