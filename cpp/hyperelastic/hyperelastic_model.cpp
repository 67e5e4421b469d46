#include "hyperelastic/hyperelastic_model.h"
#include "base/vec3.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double min_volume_ratio = 0.3;   // of an element, over that before a tool moves
constexpr double most_stiffening = 1;      // by a move, of the logarithm of the largest shear modulus over that at rest
constexpr double arrival_tolerance = 1e-9; // mm
constexpr double armijo = 1e-4;            // sufficient decrease
constexpr double rounding = 1e-13;         // relative, of the energy

// x = base + factor direction
void step_along(const std::vector<double>& base, double factor, const std::vector<double>& direction,
                std::vector<double>& x) {
    std::copy(base.begin(), base.end(), x.begin());
    add(factor, direction.data(), x.data(), int(x.size()));
}

} // namespace

Configuration::Configuration(int unknowns, int elements)
    : u(unknowns), gradient(unknowns), volume_ratio(elements, 1.0) {}

HyperelasticState::HyperelasticState(const HyperelasticEnergy& e, const Supernodes& tree, const float* value,
                                     const std::vector<int>& free_nodes)
    : rest_stiffness(tree, value, free_nodes, e.nodes()), constraints(e.nodes(), HyperelasticModel::most_contacts),
      lbfgs(3 * e.nodes(), HyperelasticModel::history), current(3 * e.nodes(), e.padded()),
      trial(3 * e.nodes(), e.padded()), other(3 * e.nodes(), e.padded()), step(3 * size_t(e.nodes())),
      direction(step.size()), preconditioned(step.size()), trial_preconditioned(step.size()), work(e.work_size()),
      force(3 * HyperelasticModel::most_contacts), gap(3 * HyperelasticModel::most_contacts) {
    u.assign(step.size(), 0);
}

HyperelasticModel::HyperelasticModel(const HyperelasticEnergy& elements, const SparseCholesky& rest,
                                     std::vector<int> free_nodes)
    : elements(elements), tree(rest.tree), free_nodes(std::move(free_nodes)), fixed(nodes(), 1), value(rest.rounded()) {
    for (int i : this->free_nodes) fixed[i] = 0;
}

std::unique_ptr<ModelState> HyperelasticModel::make_state() const {
    auto state = std::make_unique<HyperelasticState>(elements, tree, value.data(), free_nodes);
    state->owner = this;
    return state;
}

bool HyperelasticModel::relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed,
                              double* displacement, int steps, double* force) const {
    std::fill_n(force, 3 * prescribed, 0.0);
    const bool good = solve(state, patches, prescribed, displacement, steps, 0, force) >= 0;
    observe_patches(state, patches, prescribed, observed, displacement, force);
    return good;
}

int HyperelasticModel::solve(ModelState& state, const ContactPatch* patches, int contacts, const double* displacement,
                             int steps, double tolerance, double* force) const {
    auto& s = static_cast<HyperelasticState&>(state);
    if (contacts > most_contacts) return -1;
    const bool new_patches = s.constraints.set_patches(patches, contacts, s.rest_stiffness);
    if (!s.constraints.independent) return -1;
    if (new_patches) {
        for (int i = 0; i < s.lbfgs.count(); i++) { // keep the pairs, projected on the new constraints
            s.constraints.project(s.lbfgs.step(i));
            s.constraints.subtract_tool_forces(s.lbfgs.change(i), s.force.data());
            s.constraints.project(s.lbfgs.image(i));
        }
        s.lbfgs.refresh();
    }
    if (new_patches && s.response) adapt_response(s);
    if (new_patches || s.u != s.current.u) { // or a caller has set u
        s.current.u = s.u;
        evaluate_current(s);
    }
    int done = 0;
    for (; done < steps; done++) {
        move_tools(s, displacement);
        if (s.tools_arrived && s.gradient_norm2 <= 2 * tolerance * tolerance * s.current.energy) break;
        if (!descent_step(s)) break;
    }
    if (steps == 0) move_tools(s, displacement);
    s.u = s.current.u;
    for (int k = 0; k < 3 * contacts; k++) force[k] = -s.force[k];
    return done;
}

// Energy and gradient at at.u; false, with an incomplete gradient, if the energy is infinite.
bool HyperelasticModel::evaluate(HyperelasticState& s, Configuration& at) const {
    const auto found = elements.energy(at.u.data(), at.gradient.data(), at.volume_ratio.data(), s.work.data());
    at.energy = found.value, at.stiffened = found.stiffened;
    if (!std::isfinite(at.energy)) return false;
    for (int i = 0; i < nodes(); i++)
        if (fixed[i]) std::fill_n(&at.gradient[3 * size_t(i)], 3, 0.0);
    return true;
}

// Subtracts the tools' forces from the gradient; out = K^-1 gradient, projected on the constraints.
void HyperelasticModel::precondition(HyperelasticState& s, Configuration& at, std::vector<double>& out) const {
    s.constraints.subtract_tool_forces(at.gradient.data(), s.force.data());
    s.rest_stiffness.solve(at.gradient.data(), out.data());
    s.constraints.project(out.data());
}

void HyperelasticModel::evaluate_current(HyperelasticState& s) const {
    elements.accept(s.current.u.data(), s.work.data());
    if (!evaluate(s, s.current)) { // a caller has set an inverted u: restart from rest
        std::fill(s.current.u.begin(), s.current.u.end(), 0.0);
        elements.accept(s.current.u.data(), s.work.data());
        s.lbfgs.clear();
        evaluate(s, s.current);
    }
    precondition_current(s);
}

void HyperelasticModel::precondition_current(HyperelasticState& s) const {
    precondition(s, s.current, s.preconditioned);
    s.gradient_norm2 = inner(s.current.gradient.data(), s.preconditioned.data(), int(s.preconditioned.size()));
}

// Moves the tools towards their displacements, as far as no element loses too much volume or stiffens too much at once.
bool HyperelasticModel::move_tools(HyperelasticState& s, const double* displacement) const {
    const int m = 3 * s.constraints.count();
    double largest_gap = 0;
    s.constraints.patch_means(s.current.u.data(), s.gap.data());
    for (int k = 0; k < m; k++) {
        s.gap[k] = displacement[k] - s.gap[k];
        largest_gap = std::max(largest_gap, std::abs(s.gap[k]));
    }
    s.tools_arrived = largest_gap <= arrival_tolerance;
    if (s.tools_arrived) return false;
    if (s.response && s.response->contacts == s.constraints.count()) {
        std::fill(s.direction.begin(), s.direction.end(), 0.0);
        for (int k = 0; k < m; k++) add(s.gap[k], s.response->column(k), s.direction.data(), int(s.direction.size()));
    } else {
        s.constraints.least_energy_move(s.gap.data(), s.direction.data());
    }
    double longest = 0;
    for (size_t i = 0; i < s.direction.size(); i += 3) longest = std::max(longest, length(&s.direction[i]));
    const double most = std::min(1.0, elements.longest_move(s.work.data()) / std::max(longest, arrival_tolerance));
    for (double fraction = most; fraction > 1e-3 * most; fraction *= 0.7) {
        step_along(s.current.u, fraction, s.direction, s.trial.u);
        if (!(elements.least_ratio(s.trial.u.data(), s.current.volume_ratio.data()) > min_volume_ratio)) continue;
        if (!evaluate(s, s.trial) || s.trial.stiffened > s.current.stiffened + most_stiffening) continue;
        std::swap(s.current, s.trial);
        if (elements.accept(s.current.u.data(), s.work.data())) evaluate(s, s.current);
        precondition_current(s);
        for (int k = 0; k < m; k++) s.gap[k] *= 1 - fraction;
        s.tools_arrived = fraction == 1;
        return true;
    }
    return false;
}

// Line search: the fraction of `direction` with sufficient decrease, its end in `trial`; 0 if there is none.
double HyperelasticModel::line_search(HyperelasticState& s, double initial_slope) const {
    const int n = int(s.direction.size());
    double fraction = 1;
    for (int tries = 0; tries < 30; tries++) {
        step_along(s.current.u, fraction, s.direction, s.trial.u);
        if (!evaluate(s, s.trial)) {
            fraction *= 0.4;
            continue;
        }
        const double slope = inner(s.trial.gradient.data(), s.direction.data(), n);
        if (s.trial.energy >
            s.current.energy + armijo * fraction * initial_slope + rounding * std::abs(s.current.energy)) {
            fraction *= std::clamp(initial_slope / (initial_slope - slope), 0.1, 0.7);
            continue;
        }
        if (std::abs(slope) < 0.5 * std::abs(initial_slope)) return fraction;
        // Far from the line's minimum: the zero of the slope by the secant.
        const double secant = std::min(
            slope > initial_slope ? fraction * initial_slope / (initial_slope - slope) : 2 * fraction, 3 * fraction);
        std::swap(s.trial, s.other);
        step_along(s.current.u, secant, s.direction, s.trial.u);
        if (evaluate(s, s.trial) && s.trial.energy < s.other.energy) return secant;
        std::swap(s.trial, s.other);
        return fraction;
    }
    return 0;
}

// One step of L-BFGS; false if the gradient is zero up to rounding.
bool HyperelasticModel::descent_step(HyperelasticState& s) const {
    const int n = int(s.direction.size());
    if (!(s.gradient_norm2 > 1e-24 * s.current.energy)) return false;
    s.direction = s.preconditioned;
    s.lbfgs.improve(s.current.gradient.data(), s.direction.data());
    for (double& x : s.direction) x = -x;
    double initial_slope = inner(s.current.gradient.data(), s.direction.data(), n);
    if (!(initial_slope < 0)) { // not a direction of descent: restart
        s.lbfgs.clear();
        for (int i = 0; i < n; i++) s.direction[i] = -s.preconditioned[i];
        initial_slope = -s.gradient_norm2;
    }
    const double fraction = line_search(s, initial_slope);
    if (fraction == 0) {
        if (s.lbfgs.count() == 0) return false;
        s.lbfgs.clear();
        return true;
    }
    precondition(s, s.trial, s.trial_preconditioned);
    for (int i = 0; i < n; i++) {
        s.step[i] = fraction * s.direction[i];
        s.direction[i] = s.trial.gradient[i] - s.current.gradient[i];
        s.preconditioned[i] = s.trial_preconditioned[i] - s.preconditioned[i];
    }
    s.lbfgs.put(s.step.data(), s.direction.data(), s.preconditioned.data());
    std::swap(s.current, s.trial);
    std::swap(s.preconditioned, s.trial_preconditioned);
    if (elements.accept(s.current.u.data(), s.work.data())) {
        evaluate(s, s.current);
        precondition_current(s);
        return true;
    }
    s.gradient_norm2 = inner(s.current.gradient.data(), s.preconditioned.data(), n);
    return true;
}

HyperelasticModel::Balance HyperelasticModel::balance(const ModelState& state) const {
    const auto& s = static_cast<const HyperelasticState&>(state);
    std::vector<double> better = s.preconditioned, moved(s.u.size()), work(s.work.size());
    Lbfgs lbfgs = s.lbfgs;
    lbfgs.improve(s.current.gradient.data(), better.data());
    elements.elastic().tangent(s.current.u.data(), s.current.u.data(), 1, moved.data(), work.data());
    double gap = 0;
    for (int k = 0; k < 3 * s.constraints.count(); k++) gap = std::max(gap, std::abs(s.gap[k]));
    const int n = int(s.u.size());
    return {std::max(s.gradient_norm2, inner(s.current.gradient.data(), better.data(), n)),
            inner(s.current.u.data(), moved.data(), n), s.tools_arrived ? 0 : gap};
}

} // namespace palpate
