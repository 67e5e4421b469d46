#pragma once
// How the stiffness of contacts changes to one that is known better, without a step of force. ComplianceModel and
// LinearMultirateModel call it in the loop's thread.
#include <cmath>

namespace palpate {

// Of the difference between the stiffness in use and the exact one, this part is left after a tick; but a tick changes
// the force by at most this part of it, since steps of some per cent can be felt.
struct StiffnessBlend {
    static constexpr double decay = 0.95, largest_step = 0.015;

    static double norm_of_product(const double* a, int n, const double* d) { // |a d|
        double sum = 0;
        for (int k = 0; k < n; k++) {
            double x = 0;
            for (int c = 0; c < n; c++) x += a[k * n + c] * d[c];
            sum += x * x;
        }
        return std::sqrt(sum);
    }

    static double norm(const double* a, int n) {
        double sum = 0;
        for (int k = 0; k < n; k++) sum += a[k] * a[k];
        return std::sqrt(sum);
    }

    // A tick: `offset` shrinks, in_use = exact + offset, (n, n) N/mm. Whether a difference that matters is left.
    static bool advance(double* in_use, double* offset, const double* exact, int n, const double* displacement) {
        const double difference = norm_of_product(offset, n, displacement);
        const double step = largest_step * norm_of_product(exact, n, displacement);
        const double left = difference * (1 - decay) > step ? 1 - step / difference : decay;
        const bool negligible = norm(offset, n * n) < 1e-8 * norm(exact, n * n);
        for (int k = 0; k < n * n; k++) {
            offset[k] = negligible ? 0 : left * offset[k];
            in_use[k] = exact[k] + offset[k];
        }
        return norm(offset, n * n) > 0.02 * norm(exact, n * n);
    }
};

} // namespace palpate
