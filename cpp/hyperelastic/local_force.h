#pragma once
// What finite strain adds to the linear contact forces near its last solution. MultirateModel evaluates it in the
// loop's thread.
#include "tissue/tissue_model.h"

namespace palpate {

// The energy beyond the linear one, P(d), of contacts with displacement d, from one solution at d0: there it has the
// solution's value, gradient and second derivative; at rest all three are zero, where linear elasticity is exact. On
// the way from rest to d0 it is the polynomial of fifth degree that both ends ask for, beyond d0 the Taylor series,
// whose second derivative fades: a hand that runs ahead of the solutions is not led by a stiffness it has left. Of
// tissue that stiffens, which would be felt far too soft there, it has the second and third derivative of the power of
// |d| that has the solution's value and slope: the slope is known better than the second derivative. Forces are its
// gradient, so that contacts which return to where they were have done no work.
struct LocalForce {
    static constexpr int most = 3 * TissueModel::max_patches;
    static constexpr double fading = 1.5; // of d0: the way in which the second derivative fades
    static constexpr double most_power = 8;
    int contacts = 0;                   // 0: none, and P = 0
    double displacement[most] = {};     // d0, mm
    double energy = 0;                  // P(d0), N mm
    double gradient[most] = {};         // at d0, N
    double curvature[most * most] = {}; // at d0, N/mm
    bool stiffens = false;              // P goes on beyond d0 as a power of the way
    double linear_work = 0;             // d0'K d0 with the linear contact stiffness K, N mm

    // Adds the gradient of P at d, (contacts, 3) mm, to `out`, N on the tissue. Returns P, N mm. scale: of P, for
    // contacts that have moved to where the tissue is stiffer or softer.
    double add_force(const double* d, double* out, double scale = 1) const;
};

} // namespace palpate
