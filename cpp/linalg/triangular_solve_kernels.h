// Dense kernels of one supernode in a substitution. Called by linalg/triangular_solve.cpp alone.
#pragma once

namespace palpate {

// What one supernode does in a substitution; L: its numbers, in the layout of FactorValues.
struct Triangle {
    int own, below; // panels of eight unknowns: its own, and the rows below
};

// own = L11^-1 own and below -= L21 own, for groups of eight right-hand sides: own (groups, 8 own panels, 8).
void forward(const float* L, const Triangle& n, int groups, float* own, float* below);
void forward(const double* L, const Triangle& n, int groups, double* own, double* below);
// own = L11^-T (own - L21' below)
void backward(const float* L, const Triangle& n, int groups, float* own, const float* below);
void backward(const double* L, const Triangle& n, int groups, double* own, const double* below);
// The same for one right-hand side. sums: room for 64 own panels.
void forward_one(const float* L, const Triangle& n, float* own, float* below);
void backward_one(const float* L, const Triangle& n, float* own, const float* below, float* sums);
void forward_one(const double* L, const Triangle& n, double* own, double* below);
void backward_one(const double* L, const Triangle& n, double* own, const double* below, double* sums);

} // namespace palpate
