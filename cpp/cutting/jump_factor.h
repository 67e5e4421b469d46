#pragma once
// The factor of the unknowns that a cut adds to a body; it grows as the blade goes on. tissue/cut_compliance.py fills
// it; one thread at a time.
#include "base/aligned_buffer.h"
#include <vector>

namespace palpate {

// M = L S L' of a symmetric matrix that grows by rows, S = +-1 for each. Once z = L^-1 b is known, more rows only add
// entries to it: the compliance between two loads changes by the sum of s z z' over the new ones. M need not be
// positive definite, but every pivot must have the sign of its row, as in a quasi-definite matrix (R. J. Vanderbei,
// SIAM J. Optim. 5 (1995) 100).
class JumpFactor {
public:
    explicit JumpFactor(int capacity); // the most unknowns; takes 4 capacity^2 bytes

    // Appends rows of the lower triangle of M, (count, size() + count), all of this sign. If a pivot is less than
    // `least` of the row's entry on the diagonal, or of the other sign, none is appended and the answer is false.
    bool append(const double* rows, int count, double sign, double least);
    // Rows from `first` on of z = L^-1 b, (size(), columns); those before are known, and b stands in the others.
    void reduce(double* b, int columns, int first) const;
    // x = L^-T S z, (size(), columns), so that M x = b.
    void expand(double* z, int columns) const;
    // The sum of s z_i z_j, 3 by 3, of two loads, each (3, size()) with rows `stride` apart.
    void block(const double* z_i, const double* z_j, int stride, double out[9]) const;

    int size() const { return int(sign.size()); }
    const int capacity;
    std::vector<double> sign;

private:
    std::vector<double, CacheAlignedAllocator<double>> lower; // packed by rows
    const double* row(int i) const { return &lower[size_t(i) * (i + 1) / 2]; }
    double* row(int i) { return &lower[size_t(i) * (i + 1) / 2]; }
    bool append_three(const double* rows, int count, int stride, double s, double least);
};

} // namespace palpate
