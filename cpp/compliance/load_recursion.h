#pragma once
// How a node's loads go on from tick to tick. LoadHistory applies it to loads and displacements alike.
#include "compliance/relaxation_spectrum.h"

namespace palpate {

// Values x (fields) of a node become step x + drive f when the force f acts on it at the end of the tick. Field 0 is
// the load of an elastic body that moves it. Springs store x_k' G x_k / (2 share_k).
struct LoadRecursion {
    static constexpr int max_fields = 1 + RelaxationSpectrum::max_terms;
    int fields = 0; // 0: an elastic body, without history
    double step[max_fields][max_fields] = {}, drive[max_fields] = {}, share[max_fields] = {};

    // p' = (f + (sum_k gain_k + l) p - sum_k decay_k h_k) / (instant + l), then h_k' = decay_k h_k + gain_k (p' - p).
    // With l = kept / (1 - kept) a dashpot beside all springs holds p back: without branches, p' = kept p + (1 - kept)
    // f.
    static LoadRecursion of(const RelaxationSpectrum& spectrum, double kept = 0) {
        LoadRecursion out;
        if (spectrum.terms == 0 && kept == 0) return out;
        const double instant = spectrum.instant + kept / (1 - kept);
        out.fields = 1 + spectrum.terms;
        out.drive[0] = 1 / instant;
        out.share[0] = 1;
        out.step[0][0] = (instant - 1) / instant;
        for (int j = 1; j < out.fields; j++) out.step[0][j] = -spectrum.decay[j - 1] / instant;
        for (int k = 1; k < out.fields; k++) {
            const double gain = spectrum.gain[k - 1];
            out.drive[k] = gain * out.drive[0];
            for (int j = 0; j < out.fields; j++) out.step[k][j] = gain * (out.step[0][j] - (j == 0));
            out.step[k][k] += spectrum.decay[k - 1];
            out.share[k] = spectrum.ratio[k - 1];
        }
        return out;
    }
};

} // namespace palpate
