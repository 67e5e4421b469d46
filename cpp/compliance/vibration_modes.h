#pragma once
// The body's lowest modes of vibration, which give it inertia. ComplianceModel uses them in the loop's thread; a
// display reads their shapes in another.
#include "tissue/contact_patch.h"
#include <cstdint>
#include <vector>

namespace palpate {

// Shapes phi with phi' M phi = 1. Mode m obeys eta'' + 2 damping omega eta' + omega^2 eta = phi' f, integrated exactly
// for a force that is constant in a tick. What the other modes add, (G - sum phi phi' / omega^2) f, follows its force
// with a lag: without them a contact would be far too soft, and without the lag too stiff in a fast tap.
struct VibrationModes {
    static constexpr int most = 256;
    static constexpr double tick = 1e-3; // s
    VibrationModes() = default;
    // frequency: rad/s. shape: (nodes, modes, 3), in 1 / sqrt(N s^2/mm). lag: s.
    VibrationModes(std::vector<double> frequency, std::vector<float> shape, double damping, double lag);
    int count() const { return int(frequency.size()); }

    std::vector<double> frequency;
    std::vector<float> shape;
    double kept = 0; // of the lag, a tick
    std::vector<double> a11, a12, a21, a22, b1,
        b2;                          // eta' = a11 eta + a12 rate + b1 f, rate' = a21 eta + a22 rate + b2 f
    std::vector<double> flexibility; // 1 / omega^2

    // sum over the nodes of weight phi, (modes, 3).
    void project(const int* nodes, const double* weight, int n, double* out) const;
    // C += the modes' compliance in a tick, beyond what (1 - kept) G has of them. a, b: (modes, 3), of two patches.
    void add_compliance(const double* a, const double* b, double C[9]) const;
    // The displacement of a node, or of a projected patch p (modes, 3), of these amplitudes (modes).
    void displacement(const double* p, const double* amplitude, double out[3]) const;
    void displacement(int node, const double* amplitude, double out[3]) const;
    void add_displacement(int node, const float* amplitude, float out[3]) const;
};

// Where the modes are: amplitude and rate, and the lagging load's part.
struct ModalMotion {
    explicit ModalMotion(const VibrationModes& modes);
    const VibrationModes& modes;
    std::vector<double> eta, rate, lagging; // (modes)
    bool at_rest = true;

    // Amplitudes of the displacement beside G q: as it is, and at the end of a tick without force.
    void amplitude(double* out) const;
    void free_amplitude(double* out) const;
    void advance(const double* load); // (modes), phi' f
    double energy() const;            // N mm, beside q' G q / 2
    void reset();
};

} // namespace palpate
