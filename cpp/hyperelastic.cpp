#include "hyperelastic.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double keep = 0.3;     // of an element's volume, when a tool moves
constexpr double arrived = 1e-9; // mm
constexpr double armijo = 1e-4;  // of the decrease that the slope promises
constexpr double noise = 1e-13;  // of the energy, by rounding

// x = base + factor way
void go(const std::vector<double>& base, double factor, const std::vector<double>& way, std::vector<double>& x) {
    std::copy(base.begin(), base.end(), x.begin());
    add(factor, way.data(), x.data(), int(x.size()));
}

} // namespace

HyperPlace::HyperPlace(int unknowns, int elements) : u(unknowns), gradient(unknowns), ratio(elements, 1.0) {}

HyperState::HyperState(int nodes, int padded, const Supernodes& tree, const float* value,
                       const std::vector<int>& moving)
    : rest(tree, value, moving, nodes), tools(nodes, Hyperelastic::most_contacts),
      pairs(3 * nodes, Hyperelastic::history), here(3 * nodes, padded), trial(3 * nodes, padded),
      other(3 * nodes, padded), step(3 * size_t(nodes)), way(step.size()), image(step.size()), image_there(step.size()),
      force(3 * Hyperelastic::most_contacts), gap(3 * Hyperelastic::most_contacts) {
    u.assign(3 * size_t(nodes), 0);
}

Hyperelastic::Hyperelastic(NeoHookean elements, const Cholesky& rest, std::vector<int> moving)
    : elements(std::move(elements)), tree(rest.tree), moving(std::move(moving)), held(nodes(), 1),
      value(rest.rounded()) {
    for (int i : this->moving) held[i] = 0;
}

std::unique_ptr<State> Hyperelastic::start() const {
    auto state = std::make_unique<HyperState>(nodes(), elements.padded(), tree, value.data(), moving);
    state->owner = this;
    return state;
}

bool Hyperelastic::advance(State& state, const Patch* patches, int closed, int open, double* displacement, int steps,
                           double* force) const {
    std::fill_n(force, 3 * closed, 0.0);
    const bool good = solve(state, patches, closed, displacement, steps, 0, force) >= 0;
    feel(state, patches, closed, open, displacement, force);
    return good;
}

int Hyperelastic::solve(State& state, const Patch* patches, int contacts, const double* displacement, int steps,
                        double tolerance, double* force) const {
    auto& s = static_cast<HyperState&>(state);
    if (contacts > most_contacts) return -1;
    const bool other_tools = s.tools.take(patches, contacts, s.rest);
    if (!s.tools.sound) return -1;
    if (other_tools) {
        for (int i = 0; i < s.pairs.count(); i++) { // what was learnt, as far as the new tools leave it free
            s.tools.still(s.pairs.step(i));
            s.tools.release(s.pairs.change(i), s.force.data());
            s.tools.still(s.pairs.image(i));
        }
        s.pairs.refresh();
    }
    if (other_tools || s.u != s.here.u) { // or somebody moved the tissue
        s.here.u = s.u;
        evaluate(s);
    }
    int done = 0;
    for (; done < steps; done++) {
        drive(s, displacement);
        if (s.there && s.slope <= 2 * tolerance * tolerance * s.here.energy) break;
        if (!descend(s)) break;
    }
    if (steps == 0) drive(s, displacement);
    s.u = s.here.u;
    for (int k = 0; k < 3 * contacts; k++) force[k] = -s.force[k];
    return done;
}

// Energy and forces; false, and not whole, if an element is flat or turned.
bool Hyperelastic::weigh(HyperPlace& place) const {
    place.energy = elements.energy(place.u.data(), place.gradient.data(), place.ratio.data()).value;
    if (!std::isfinite(place.energy)) return false;
    for (int i = 0; i < nodes(); i++)
        if (held[i]) std::fill_n(&place.gradient[3 * size_t(i)], 3, 0.0);
    return true;
}

// The tools' forces taken off the gradient, and K^-1 of what is left.
void Hyperelastic::finish(HyperState& s, HyperPlace& place, std::vector<double>& image) const {
    s.tools.release(place.gradient.data(), s.force.data());
    s.rest.solve(place.gradient.data(), image.data());
    s.tools.still(image.data());
}

void Hyperelastic::evaluate(HyperState& s) const {
    if (!weigh(s.here)) { // a state that somebody turned inside out: begin anew
        std::fill(s.here.u.begin(), s.here.u.end(), 0.0);
        s.pairs.clear();
        weigh(s.here);
    }
    finish(s, s.here, s.image);
    s.slope = inner(s.here.gradient.data(), s.image.data(), int(s.image.size()));
}

// Moves the tools towards where they are told to be, as far as the elements bear at once.
bool Hyperelastic::drive(HyperState& s, const double* displacement) const {
    const int m = 3 * s.tools.count();
    double apart = 0;
    s.tools.means(s.here.u.data(), s.gap.data());
    for (int k = 0; k < m; k++) {
        s.gap[k] = displacement[k] - s.gap[k];
        apart = std::max(apart, std::abs(s.gap[k]));
    }
    s.there = apart <= arrived;
    if (s.there) return false;
    s.tools.reach(s.gap.data(), s.way.data());
    for (double part = 1; part > 1e-3; part *= 0.7) {
        go(s.here.u, part, s.way, s.trial.u);
        if (!(elements.least_ratio(s.trial.u.data(), s.here.ratio.data()) > keep)) continue;
        std::swap(s.here.u, s.trial.u);
        evaluate(s);
        for (int k = 0; k < m; k++) s.gap[k] *= 1 - part;
        s.there = part == 1;
        return true;
    }
    return false;
}

// A part of `way` along which the energy falls enough, its end in `trial`; 0 if there is none.
double Hyperelastic::search(HyperState& s, double along) const {
    const int n = int(s.way.size());
    double part = 1;
    for (int tries = 0; tries < 30; tries++) {
        go(s.here.u, part, s.way, s.trial.u);
        if (!weigh(s.trial)) {
            part *= 0.4;
            continue;
        }
        const double slope = inner(s.trial.gradient.data(), s.way.data(), n);
        if (s.trial.energy > s.here.energy + armijo * part * along + noise * std::abs(s.here.energy)) {
            part *= std::clamp(along / (along - slope), 0.1, 0.7);
            continue;
        }
        if (std::abs(slope) < 0.5 * std::abs(along)) return part;
        // Far from the line's minimum: where the slope would vanish if it were straight.
        const double better = std::min(slope > along ? part * along / (along - slope) : 2 * part, 3 * part);
        std::swap(s.trial, s.other);
        go(s.here.u, better, s.way, s.trial.u);
        if (weigh(s.trial) && s.trial.energy < s.other.energy) return better;
        std::swap(s.trial, s.other);
        return part;
    }
    return 0;
}

// One step of descent; false when rounding leaves nothing to gain.
bool Hyperelastic::descend(HyperState& s) const {
    const int n = int(s.way.size());
    if (!(s.slope > 1e-24 * s.here.energy)) return false;
    s.way = s.image;
    s.pairs.improve(s.here.gradient.data(), s.way.data());
    for (double& x : s.way) x = -x;
    double along = inner(s.here.gradient.data(), s.way.data(), n);
    if (!(along < 0)) { // what was learnt is of no use here
        s.pairs.clear();
        for (int i = 0; i < n; i++) s.way[i] = -s.image[i];
        along = -s.slope;
    }
    const double part = search(s, along);
    if (part == 0) {
        if (s.pairs.count() == 0) return false;
        s.pairs.clear();
        return true;
    }
    finish(s, s.trial, s.image_there);
    for (int i = 0; i < n; i++) {
        s.step[i] = part * s.way[i];
        s.way[i] = s.trial.gradient[i] - s.here.gradient[i];
        s.image[i] = s.image_there[i] - s.image[i];
    }
    s.pairs.put(s.step.data(), s.way.data(), s.image.data());
    std::swap(s.here, s.trial);
    std::swap(s.image, s.image_there);
    s.slope = inner(s.here.gradient.data(), s.image.data(), n);
    return true;
}

Hyperelastic::Balance Hyperelastic::balance(const State& state) const {
    const auto& s = static_cast<const HyperState&>(state);
    std::vector<double> better = s.image, moved(s.u.size());
    Pairs learnt = s.pairs;
    learnt.improve(s.here.gradient.data(), better.data());
    elements.tangent(s.here.u.data(), s.here.u.data(), moved.data());
    double gap = 0;
    for (int k = 0; k < 3 * s.tools.count(); k++) gap = std::max(gap, std::abs(s.gap[k]));
    const int n = int(s.u.size());
    return {std::max(s.slope, inner(s.here.gradient.data(), better.data(), n)), inner(s.here.u.data(), moved.data(), n),
            s.there ? 0 : gap};
}

} // namespace palpate
