#pragma once
// The tools' displacements as linear constraints W'u = d. HyperelasticState owns one; used in the loop's thread.
#include "hyperelastic/rest_stiffness.h"
#include <vector>

namespace palpate {

// Each patch prescribes its weighted mean displacement. K is the stiffness at rest, C = W'K^-1 W; K^-1 W is stored, so
// that moves and projections need no solve. Allocates only when it is made.
class ContactConstraints {
public:
    ContactConstraints(int nodes, int max_contacts);

    // True if the patches differ from those before. Afterwards `independent` says whether C is invertible.
    bool set_patches(const ContactPatch* patches, int contacts, RestStiffness& rest);
    bool independent = true;
    int count() const { return contacts; }

    void patch_means(const double* u, double* out) const;         // out = W'u, (contacts, 3)
    void least_energy_move(const double* gap, double* out) const; // out = K^-1 W C^-1 gap, so that W'out = gap
    void project(double* v) const;                                // v -= K^-1 W C^-1 W'v, so that W'v = 0
    void rest_stiffness(double* out) const;                       // C^-1, (3 contacts, 3 contacts) N/mm, symmetric
    void subtract_tool_forces(double* g, double* force) const;    // force = C^-T W'K^-1 g, g -= W force

private:
    const int n;
    int contacts = 0;
    std::vector<ContactPatch> patch;
    std::vector<double> columns; // K^-1 W, (3 contacts, unknowns)
    std::vector<double> inverse; // of C, (3 contacts, 3 contacts)
    std::vector<double> work;
    mutable std::vector<double> mean;
    bool invert();
    void add_move(double sign, const double* gap, double* out) const;
};

} // namespace palpate
