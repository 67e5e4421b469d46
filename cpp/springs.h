#pragma once
#include "rings.h"

namespace palpate {

// How the ratio of spring constants RSC = k_h / k_e grows with the row r (1 at the contact), a and b its parameters.
struct SpringLaw {
    enum class Kind { uniform, linear, exponential } kind = Kind::uniform;
    double a = 0.1; // uniform: RSC = a; linear: RSC = a r; exponential: RSC = 1 - exp(a r), a < 0
    // The row as a whole number (the dissertation's table), or 1 + distance from the contact in edge lengths: the same
    // growth without the steps that a moving contact feels each time a node changes rows.
    bool by_distance = false;
    double edge = 1; // mm, of one row when by_distance
    double operator()(double row) const;
};

// The dissertation's model: each node tied to home by a spring k_h and to its neighbours by linear springs
// k_e (u_j - u_i). The three directions do not mix.
class Springs : public RingModel {
public:
    // start (nodes + 1), column, stiffness (start[nodes]) N/mm > 0: edge springs, symmetric, no diagonal.
    // position: (nodes, 3) mm at rest. imposed: every touched node goes with the tool (the dissertation's contact).
    Springs(const int32_t* start, const int32_t* column, const double* stiffness, const double* position, int nodes,
            std::vector<uint8_t> held, SpringLaw law, double relaxation, bool imposed);
    void internal_force(const State& state, double* out) const override;
    // Least diag(K)^-1 K can stretch anything: 1 - rho, rho <= sum / (sum + home), as the contact now stands.
    double contraction(const State& state) const;

private:
    std::vector<double> stiffness, sum, position;
    const SpringLaw law;
    const bool rigid;
    void prepare(RingState& s) const override;
    void touched_matrix(RingState& s, double* A) const override;
    void touched_right(RingState& s) const override;
    void enter(RingState& s) const override;
    void relax(RingState& s, int first) const override;
    void leave(RingState& s) const override;
    double weighed(const RingState& s, int node, const double r[3]) const override;
    bool stiffness_follows_weights() const override { return law.by_distance; }
    bool imposed() const override { return rigid; }
    void impose(RingState& s, const double* displacement, double* force) const override;
    void pull(const RingState& s, int node, double out[3]) const;
};

} // namespace palpate
