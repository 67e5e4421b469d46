#include "hyperelastic/hyperelastic_model.h"
#include <algorithm>
#include <cmath>

namespace palpate {

// Columns of earlier patches are moved to those in use by the least energy at rest, then improved by conjugate
// gradients, preconditioned by the stiffness at rest and projected on the constraints as the descent is. Three columns
// at a time, each with its own step lengths.
void HyperelasticModel::respond(HyperelasticState& s, int steps) const {
    ContactResponse& r = *s.response;
    const int m = 3 * s.constraints.count(), n = r.unknowns;
    adapt_response(s);
    double ignored[3 * most_contacts];
    for (int first = 0; first < m; first += 3) {
        double *y = r.column(first), *Ky = r.image_of(first), before[3];
        tangents(s, y, Ky);
        for (int step = 0;; step++) {
            std::copy_n(Ky, 3 * size_t(n), r.residual.begin());
            for (int j = 0; j < 3; j++) s.constraints.subtract_tool_forces(&r.residual[size_t(j) * n], ignored);
            s.rest_stiffness.solve_three(r.residual.data(), r.preconditioned.data());
            for (int j = 0; j < 3; j++) {
                double *z = &r.preconditioned[size_t(j) * n], *p = &r.direction[size_t(j) * n];
                s.constraints.project(z);
                const double square = std::max(inner(&r.residual[size_t(j) * n], z, n), 0.0);
                const double share = step && before[j] > 0 ? square / before[j] : 0;
                r.excess[first + j] = before[j] = square;
                if (step < steps)
                    for (int i = 0; i < n; i++) p[i] = share * p[i] - z[i];
            }
            if (step == steps) break;
            tangents(s, r.direction.data(), r.image.data());
            for (int j = 0; j < 3; j++) {
                const double *p = &r.direction[size_t(j) * n], *Kp = &r.image[size_t(j) * n];
                const double curvature = inner(p, Kp, n);
                if (!(curvature > 0)) continue; // solved, or no stable equilibrium
                add(before[j] / curvature, p, y + size_t(j) * n, n);
                add(before[j] / curvature, Kp, Ky + size_t(j) * n, n);
            }
        }
    }
    for (int k = 0; k < m; k++)
        for (int j = 0; j <= k; j++)
            r.stiffness[k * m + j] = r.stiffness[j * m + k] =
                0.5 * (inner(r.column(k), r.image_of(j), n) + inner(r.column(j), r.image_of(k), n));
    read_response(s);
}

// W'Y = I, so what subtract_tool_forces() has taken from the gradient comes back.
void HyperelasticModel::read_response(HyperelasticState& s) const {
    ContactResponse& r = *s.response;
    const int m = 3 * s.constraints.count();
    double mean[3 * most_contacts], work = 0, sensitivity = 0;
    s.constraints.patch_means(s.current.u.data(), mean);
    for (int k = 0; k < m; k++) {
        r.force[k] = s.force[k] + inner(r.column(k), s.current.gradient.data(), r.unknowns);
        work += r.force[k] * mean[k];
        sensitivity += std::abs(mean[k]) * std::sqrt(r.excess[k]);
    }
    r.error = (sensitivity * std::sqrt(s.gradient_norm2) + s.gradient_norm2) / std::max(std::abs(work), 1e-12);
}

// Columns for the patches in use: those there are, and new ones from rest.
void HyperelasticModel::adapt_response(HyperelasticState& s) const {
    ContactResponse& r = *s.response;
    const int contacts = s.constraints.count(), m = 3 * contacts, n = r.unknowns;
    for (int k = 3 * std::min(r.contacts, contacts); k < m; k++) std::fill_n(r.column(k), n, 0.0);
    r.contacts = contacts;
    double gap[3 * most_contacts];
    for (int k = 0; k < m; k++) {
        s.constraints.patch_means(r.column(k), gap);
        for (int j = 0; j < m; j++) gap[j] = (j == k) - gap[j];
        s.constraints.least_energy_move(gap, s.direction.data());
        add(1, s.direction.data(), r.column(k), n);
    }
}

// out = K(u) v on the free nodes, of three v
void HyperelasticModel::tangents(HyperelasticState& s, const double* v, double* out) const {
    elements.tangent(s.current.u.data(), v, 3, out, s.work.data());
    for (int j = 0; j < 3; j++)
        for (int i = 0; i < nodes(); i++)
            if (fixed[i]) std::fill_n(&out[j * s.u.size() + 3 * size_t(i)], 3, 0.0);
}

} // namespace palpate
