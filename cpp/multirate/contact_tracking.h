#pragma once
// Which contacts a tick has, compared with the tick before. The models of this folder call it in the loop's thread.
#include "tissue/contact_patch.h"
#include <cmath>

namespace palpate {

// The contact that is gone: those left keep their order, and a displacement changes little in a tick.
inline int contact_gone(const double* before, int count, const double* now) {
    int best = count - 1;
    double least = INFINITY;
    for (int gone = 0; gone < count; gone++) {
        double sum = 0;
        for (int k = 0; k < 3 * (count - 1); k++) sum += std::abs(now[k] - before[k < 3 * gone ? k : k + 3]);
        if (sum < least) least = sum, best = gone;
    }
    return best;
}

inline bool same(const ContactPatch& a, const ContactPatch& b) {
    return a.count == b.count && std::equal(a.node, a.node + a.count, b.node) &&
           std::equal(a.weight, a.weight + a.count, b.weight);
}

} // namespace palpate
