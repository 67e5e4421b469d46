#pragma once
// How the stiffness of a tissue relaxes: a generalised Maxwell solid, as a Prony series. LoadHistory uses it in ticks.
// Recursion: R. L. Taylor, K. S. Pister & G. L. Goudreau, Int. J. Numer. Methods Eng. 2 (1970) 45.
#include <cmath>
#include <stdexcept>

namespace palpate {

// E(t) / E(infinity) = 1 + sum_k ratio_k exp(-t / tau_k), for the whole stiffness matrix alike. Branch k then carries
// h_k <- decay_k h_k + gain_k (p' - p) when the elastic force goes from p to p' in a tick, evenly.
struct RelaxationSpectrum {
    static constexpr int max_terms = 6;
    static constexpr double tick = 1e-3; // s
    int terms = 0;
    double ratio[max_terms] = {}, decay[max_terms] = {}, gain[max_terms] = {};
    double instant = 1; // force at the end of a tick over the change of the elastic force in it

    // share: of the instantaneous modulus, that relaxes with `time` s; the long-term modulus is what is left of 1.
    void add(double share, double time, double all_shares) {
        if (terms == max_terms) throw std::invalid_argument("relaxation: too many terms");
        const double x = tick / time;
        ratio[terms] = share / (1 - all_shares);
        decay[terms] = std::exp(-x);
        gain[terms] = ratio[terms] * -std::expm1(-x) / x;
        instant += gain[terms++];
    }
};

} // namespace palpate
