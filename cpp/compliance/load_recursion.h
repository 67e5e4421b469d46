#pragma once
// How a node's loads go on from tick to tick. LoadHistory applies it to loads and displacements alike.
#include "compliance/relaxation_spectrum.h"

namespace palpate {

// Values x (fields) of a node become step x + drive f when the force f acts on it at the end of the tick. The body
// moves by u = sum_s direct_s G_s f + sum_k shown_k C_k x_k with C_k = sum_s mix_ks G_s, where the G_s are its
// compliances at some samples of the Laplace variable. Springs store x_k' C_k x_k / (2 share_k).
struct LoadRecursion {
    static constexpr int max_fields = 1 + RelaxationSpectrum::max_terms, max_samples = 1 + max_fields;
    int fields = 0, samples = 1; // without fields an elastic body, which has no history
    double step[max_fields][max_fields] = {}, drive[max_fields] = {}, share[max_fields] = {}, shown[max_fields] = {};
    double direct[max_samples] = {1}, mix[max_fields][max_samples] = {};

    // What G_s adds to the compliance in a tick.
    double response(int s) const {
        double sum = direct[s];
        for (int k = 0; k < fields; k++) sum += shown[k] * drive[k] * mix[k][s];
        return sum;
    }
    // The same for a body that responds alike at all samples.
    double response() const {
        double sum = 0;
        for (int s = 0; s < samples; s++) sum += response(s);
        return sum;
    }

    // p' = (f + (sum_k gain_k + l) p - sum_k decay_k h_k) / (instant + l), then h_k' = decay_k h_k + gain_k (p' - p).
    // With l = kept / (1 - kept) a dashpot beside all springs holds p back: without branches, p' = kept p + (1 - kept)
    // f.
    static LoadRecursion of(const RelaxationSpectrum& spectrum, double kept = 0) {
        LoadRecursion out;
        if (spectrum.terms == 0 && kept == 0) return out;
        const double instant = spectrum.instant + kept / (1 - kept);
        out.fields = 1 + spectrum.terms;
        out.direct[0] = 0;
        out.shown[0] = 1; // field 0 is the load of an elastic body that moves as this one
        for (int k = 0; k < out.fields; k++) out.mix[k][0] = 1;
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

    // A body whose parts relax each in its own way: u = G_inst f + sum_k C_k x_k, tau_k x_k' = f - x_k. mix: (times,
    // samples), whose last sample is the instantaneous compliance. With the force at the end of the tick, no tick gives
    // energy if all C_k are positive semidefinite: f' C (x' - x) >= (x' C x' - x C x) / 2.
    static LoadRecursion of(const std::vector<double>& times, const std::vector<double>& mix) {
        LoadRecursion out;
        out.fields = int(times.size()), out.samples = out.fields ? int(mix.size() / times.size()) : 1;
        if (out.fields > max_fields || out.samples > max_samples)
            throw std::invalid_argument("LoadRecursion: too many times or samples");
        out.direct[0] = 0, out.direct[out.samples - 1] = 1;
        for (int k = 0; k < out.fields; k++) {
            out.step[k][k] = std::exp(-RelaxationSpectrum::tick / times[k]);
            out.drive[k] = -std::expm1(-RelaxationSpectrum::tick / times[k]);
            out.share[k] = out.shown[k] = 1;
            for (int s = 0; s < out.samples; s++) out.mix[k][s] = mix[size_t(k) * out.samples + s];
        }
        return out;
    }
};

} // namespace palpate
