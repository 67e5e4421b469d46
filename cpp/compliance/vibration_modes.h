#pragma once
// The body's lowest modes of vibration, which give it inertia. ComplianceModel uses them in the loop's thread; a
// display reads their shapes in another.
#include "compliance/load_recursion.h"
#include "tissue/contact_patch.h"
#include <vector>

namespace palpate {

// Shapes phi with phi' M phi = 1. Mode m obeys eta'' + 2 damping omega eta' + omega^2 eta + sum_k h_k = phi' f, where
// the branches of a stiffness that relaxes obey h_k' = ratio_k omega^2 eta' - h_k / tau_k. It is integrated exactly for
// a force that is constant in a tick. What the other modes add, (G - sum phi phi' / omega^2) q, follows its force with
// a lag: without them a contact would be far too soft, and without the lag too stiff in a fast tap.
struct VibrationModes {
    static constexpr int most = 256, most_width = 2 + RelaxationSpectrum::max_terms;
    VibrationModes() = default;
    // frequency: rad/s. shape: (nodes, modes, 3), in 1 / sqrt(N s^2/mm). lag: s.
    VibrationModes(std::vector<double> frequency, std::vector<float> shape, double damping, double lag,
                   const RelaxationSpectrum& spectrum);
    int count() const { return int(frequency.size()); }

    std::vector<double> frequency, flexibility; // rad/s, and 1 / omega^2
    std::vector<float> shape;
    int width = 2;                   // of a mode's state: eta, its rate, the branches
    std::vector<double> step, drive; // (modes, width, width), (modes, width): state' = step state + drive phi' f
    LoadRecursion loads;             // of q

    // sum over the nodes of weight phi, (modes, 3).
    void project(const int* nodes, const double* weight, int n, double* out) const;
    // C += the modes' compliance in a tick, beyond what G has of them there. a, b: (modes, 3), of two patches.
    void add_compliance(const double* a, const double* b, double C[9]) const;
    // The displacement of a node, or of a projected patch p (modes, 3), of these amplitudes (modes).
    void displacement(const double* p, const double* amplitude, double out[3]) const;
    void displacement(int node, const double* amplitude, double out[3]) const;
    void add_displacement(int node, const float* amplitude, float out[3]) const;
};

// Where the modes are, and what the lagging loads have of them.
struct ModalMotion {
    explicit ModalMotion(const VibrationModes& modes);
    const VibrationModes& modes;
    std::vector<double> state;   // (modes, width)
    std::vector<double> lagging; // (modes, loads.fields)
    bool at_rest = true;

    double eta(int m) const { return state[size_t(modes.width) * m]; }
    double rate(int m) const { return state[size_t(modes.width) * m + 1]; }
    // Amplitudes of the displacement beside G q: as it is, and at the end of a tick without force.
    void amplitude(double* out) const;
    void free_amplitude(double* out) const;
    void advance(const double* load); // (modes), phi' f; null: none
    double energy() const;            // N mm, beside that of q in G
    void reset();
};

} // namespace palpate
