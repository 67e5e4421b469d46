// Sparse Cholesky factorization by the multifrontal method (I. S. Duff & J. K. Reid, ACM Trans. Math. Softw. 9 (1983)
// 302). Made by bindings/linalg.cpp before the loop starts, on all threads; constant from then on.
#pragma once
#include "linalg/supernodes.h"

namespace palpate {

// K = L L' of a symmetric positive definite matrix. Each supernode gathers its entries of K and its children's Schur
// complements in a dense front, eliminates its own columns, and hands the rest on. Subtrees and large fronts run on
// threads; every number is summed in an order that the tree alone decides, so the bits do not depend on their number.
class SparseCholesky {
public:
    SparseCholesky(const BlockCsr& K, const double* places); // places: (nodes, 3) mm, to cut the nodes in halves

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
