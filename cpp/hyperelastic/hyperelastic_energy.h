#pragma once
// What a hyperelastic model needs of its elements: their energy, its gradient and tangent. HyperelasticModel calls it
// in the loop's thread. Immutable: what a call writes, the caller owns.
#include <cstddef>
#include <limits>

namespace palpate {

class HyperelasticEnergy {
public:
    struct Energy {
        double value;         // N mm; infinite if an element is flat, inverted or stiffer than numbers can say
        double least;         // smallest J
        double stiffened = 0; // the largest logarithm of how much the shear modulus has grown
    };
    virtual ~HyperelasticEnergy() = default;
    virtual int nodes() const = 0;
    virtual int padded() const = 0;       // elements, rounded up
    virtual size_t work_size() const = 0; // numbers of working memory, `work` below

    // Energy of the displacement u (nodes, 3) mm, and force = dE/du (nodes, 3) N, the external force that balances it;
    // ratio: (padded()) J of each element. If the energy is infinite, force and ratio are incomplete.
    virtual Energy energy(const double* u, double* force, double* ratio, double* work) const = 0;

    // Smallest J(u) / ratio over the elements.
    virtual double least_ratio(const double* u, const double* ratio) const = 0;

    static constexpr int most_directions = 3;
    // out = K(u) v, N: the derivatives of the force along `count` directions v (count, nodes, 3) mm, at most
    // most_directions; three at once take half the time of three calls. All J must be positive.
    virtual void tangent(const double* u, const double* v, int count, double* out, double* work) const = 0;

    // The elements without any contact between them.
    virtual const HyperelasticEnergy& elastic() const { return *this; }

    // A descent has accepted u; true if the energy there may be another one from now on. From one to the next no node
    // may move further than longest_move() mm.
    virtual bool accept(const double*, double*) const { return false; }
    virtual double longest_move(const double*) const { return std::numeric_limits<double>::infinity(); }
};

} // namespace palpate
