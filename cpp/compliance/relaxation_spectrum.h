#pragma once
// How the stiffness of a tissue relaxes: a generalised Maxwell solid, as a Prony series. LoadRecursion and
// VibrationModes are made of it. Recursion: R. L. Taylor, K. S. Pister & G. L. Goudreau, Int. J. Numer. Methods Eng. 2
// (1970) 45.
#include <array>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace palpate {

// E(t) / E(infinity) = 1 + sum_k ratio_k exp(-t / time_k), for the whole stiffness matrix alike. Branch k then carries
// h_k <- decay_k h_k + gain_k (p' - p) when the elastic force goes from p to p' in a tick, evenly.
struct RelaxationSpectrum {
    static constexpr int max_terms = 6;
    static constexpr double tick = 1e-3; // s
    int terms = 0;
    double ratio[max_terms] = {}, time[max_terms] = {}, decay[max_terms] = {}, gain[max_terms] = {};
    double instant = 1; // force at the end of a tick over the change of the elastic force in it

    RelaxationSpectrum() = default; // an elastic body
    // Of each term the share of the instantaneous modulus, and the time in s with which it relaxes. The long-term
    // modulus is what the shares leave.
    explicit RelaxationSpectrum(const std::vector<std::array<double, 2>>& series) : terms(int(series.size())) {
        if (terms > max_terms) throw std::invalid_argument("relaxation: too many terms");
        double left = 1;
        for (const auto& term : series) left -= term[0];
        for (int k = 0; k < terms; k++) {
            time[k] = series[k][1];
            const double x = tick / time[k];
            ratio[k] = series[k][0] / left;
            decay[k] = std::exp(-x);
            gain[k] = ratio[k] * -std::expm1(-x) / x;
            instant += gain[k];
        }
    }
};

} // namespace palpate
