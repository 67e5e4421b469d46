#pragma once
// Deflation by the slow modes of an elastic body. BlockGaussSeidel calls it between sweeps, in the loop's thread.
// Method: R. A. Nicolaides, SIAM J. Numer. Anal. 24 (1987) 355.
#include "tissue/contact_patch.h"
#include <vector>

namespace palpate {

// Gauss-Seidel sweeps converge slowly for deformations of the whole body, such as an organ that tilts on a narrow
// support. Minimising the energy exactly over a few such modes, with the tools' displacements kept, removes them.
class ModeDeflation {
public:
    static constexpr int count = 12;
    ModeDeflation() = default;
    // shape: (nodes, 3, count), 0 at fixed nodes, shape' K shape = 1 (a column of zeros is no mode); load = K shape.
    ModeDeflation(const double* shape, const double* load, int nodes);
    bool empty() const { return shape.empty(); }

    // An orthonormal basis of the amplitudes that would move a tool. weight: (contacts, capacity).
    struct Constraints {
        int rows = 0;
        double row[count][count];
    };
    void constrain(const int* contact_nodes, int node_count, const double* weight, int contacts,
                   Constraints& out) const;

    // Minimises the energy u'Ku/2 over the modes; no contact's mean displacement changes. u: (nodes, 3).
    void deflate(const Constraints& constraints, double* u) const;

private:
    std::vector<double> shape, load;
};

} // namespace palpate
