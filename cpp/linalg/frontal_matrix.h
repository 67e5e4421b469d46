// Partial Cholesky factorization of a dense front. Called by linalg/sparse_cholesky.cpp, on its threads.
#pragma once
#include "linalg/supernodes.h"

namespace palpate {

// A dense symmetric matrix of which some leading columns are eliminated. Kept in panels of eight rows: panel p holds
// rows 8p .. 8p + 7 of columns 0 .. 8p + 7, column by column, so that eight rows of a column lie side by side and the
// kernels need no packing. Entries above the diagonal have no meaning.
struct FrontalMatrix {
    static constexpr int panel = Supernodes::panel;
    static int64_t offset(int p) { return int64_t(panel) * panel * p * (p + 1) / 2; }
    static int64_t size(int panels) { return offset(panels); }
    double* data;
    int panels;
    double* at(int p) const { return data + offset(p); }
};

// Replaces the first `own` panels' columns by those of the Cholesky factor and the rest by its Schur complement.
// inverse: (own, 64) becomes the inverse of each diagonal tile of the factor, column by column. False: a pivot was not
// positive, and nothing has meaning. Large fronts use threads; the result does not depend on how many.
bool eliminate(const FrontalMatrix& front, int own, double* inverse);

} // namespace palpate
