#pragma once
#include "model.h"
#include <vector>

namespace palpate {

// The slowest shapes of an elastic body. Sweeps move news from node to node and are slow at what the whole body does
// together, such as an organ that tilts on a narrow support; here some sweeps are followed by the exact minimum of the
// energy over a few such shapes, the tools kept where they are (deflation, the coarse half of a two-level method).
class Modes {
public:
    static constexpr int count = 12;
    Modes() = default;
    // shape: (nodes, 3, count), 0 at held nodes, shape' K shape = 1 (a column of zeros is no mode); load = K shape.
    Modes(const double* shape, const double* load, int nodes);
    bool empty() const { return shape.empty(); }

    // What contacts leave free: an orthonormal basis of the amplitudes that they forbid. weight: (contacts, capacity).
    struct Bound {
        int rows = 0;
        double row[count][count];
    };
    void bind(const int* touched, int touched_count, const double* weight, int contacts, Bound& bound) const;

    // Lowers the energy u'Ku/2 to its minimum over the modes; no contact's mean displacement changes. u: (nodes, 3).
    void settle(const Bound& bound, double* u) const;

private:
    std::vector<double> shape, load;
};

} // namespace palpate
