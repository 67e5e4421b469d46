#pragma once
#include "cholesky.h"
#include "model.h"
#include "neo_hookean.h"
#include "pairs.h"
#include "tools.h"

namespace palpate {

// Where a tissue is, and what is known there.
struct HyperPlace {
    HyperPlace(int unknowns, int elements);
    std::vector<double> u, gradient, ratio; // mm; dE/du less the tools' forces, N; J of each element
    double energy = 0;                      // N mm
};

struct HyperState : State {
    HyperState(int nodes, int padded, const Supernodes& tree, const float* value, const std::vector<int>& moving);
    RestSolve rest;
    Tools tools;
    Pairs pairs;
    HyperPlace here, trial, other;
    std::vector<double> step, way, image, image_there; // image = K^-1 gradient
    std::vector<double> force;                         // (contacts, 3) N of the tools on the tissue
    std::vector<double> gap;                           // (contacts, 3) mm that the tools still have to go
    double slope = 0;                                  // gradient' K^-1 gradient, N mm
    bool there = true;                                 // are the tools where they want to be?
};

// Quasi-static equilibrium at finite strain: the least energy of neo-Hookean elements under W'u = d. Descends by
// limited-memory BFGS from the factored stiffness at rest (M. Liu, S. Bouaziz & L. Kavan, ACM Trans. Graph. 36 (2017)
// 23), along directions that keep the constraint, so that the tools are where they are told to be after every step. A
// tool that is told to go far goes in parts, each as long as no element loses more than 70 % of its volume at once,
// with a descent between; no step of any kind is taken that turns an element inside out.
class Hyperelastic : public Model {
public:
    static constexpr int most_contacts = 16, history = 16;

    // rest: the factored stiffness at rest of the nodes `moving`, in that order; it must outlive this.
    Hyperelastic(NeoHookean elements, const Cholesky& rest, std::vector<int> moving);

    int nodes() const override { return elements.nodes(); }
    std::unique_ptr<State> start() const override;
    bool advance(State& state, const Patch* patches, int closed, int open, double* displacement, int sweeps,
                 double* force) const override;
    double energy(const State& state, int, const double*, const double*) const override {
        return static_cast<const HyperState&>(state).here.energy;
    }

    // At most `steps` steps of descent, fewer once gradient' K^-1 gradient is below tolerance^2 times twice the energy.
    // -1, and nothing moved, when the contacts are more than most_contacts or cannot be told apart; else the steps
    // taken. force: (contacts, 3) N of the tissue on the tools.
    int solve(State& state, const Patch* patches, int contacts, const double* displacement, int steps, double tolerance,
              double* force) const;

    // What an estimate of the error needs, all N mm: residual = g'Hg with the rest's inverse or with the one the
    // descent has learnt, whichever is larger; size = u'K(u)u, K(u) the tangent. `gap`: mm that a tool still has to go.
    struct Balance {
        double residual, size, gap;
    };
    Balance balance(const State& state) const;

    const NeoHookean elements;

private:
    const Supernodes& tree;
    const std::vector<int> moving;
    std::vector<uint8_t> held;
    const FactorValues<float> value;
    void evaluate(HyperState& s) const;
    bool weigh(HyperPlace& place) const;
    void finish(HyperState& s, HyperPlace& place, std::vector<double>& image) const;
    bool drive(HyperState& s, const double* displacement) const;
    bool descend(HyperState& s) const;
    double search(HyperState& s, double along) const;
};

} // namespace palpate
