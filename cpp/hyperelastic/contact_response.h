#pragma once
// How a tissue at finite strain gives when its tools move on. A HyperelasticState may own one;
// HyperelasticModel::respond fills it, in the thread that solves.
#include <cstddef>
#include <vector>

namespace palpate {

// The derivative Y of the equilibrium by the tools' displacements: column k minimises y'K(u)y / 2 under W'y = e_k. An
// error of size e in u and of size d in Y makes one of order d e in the force Y'dE/du, and of order d^2 in the contact
// stiffness Y'K Y: both converge faster than what they are made of. Allocates only when it is made.
struct ContactResponse {
    ContactResponse(int nodes, int most_contacts)
        : unknowns(3 * nodes), columns(3 * size_t(most_contacts) * unknowns), images(columns.size()),
          residual(3 * size_t(unknowns)), preconditioned(residual.size()), direction(residual.size()),
          image(residual.size()), stiffness(9 * size_t(most_contacts) * most_contacts),
          force(3 * size_t(most_contacts)), excess(force.size()) {}
    const int unknowns;
    int contacts = 0;                                               // of the columns in use
    std::vector<double> columns, images;                            // (3 contacts, unknowns) Y and K Y
    std::vector<double> residual, preconditioned, direction, image; // of three columns
    std::vector<double> stiffness;                                  // (3 contacts, 3 contacts) N/mm, Y'K Y
    std::vector<double> force;  // (contacts, 3) N of the tools on the tissue, Y'dE/du
    std::vector<double> excess; // (3 contacts) N/mm: how far each column is from its least y'K y, estimated
    double error = 0;           // of the force's work on the tools, relative to it, estimated
    double* column(int k) { return &columns[size_t(k) * unknowns]; }
    double* image_of(int k) { return &images[size_t(k) * unknowns]; }
    void clear() { contacts = 0; }
};

} // namespace palpate
