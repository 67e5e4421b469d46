#include "solve.h"

namespace palpate {
namespace {

// ψ'(t)/t of eight pairs.
template <Potential potential> PALPATE_INLINE void curvature_at(const Law& law, const Lanes& t, Lanes& out) {
    float in[lanes], k[lanes];
    store(in, t);
    for (int i = 0; i < lanes; i++) k[i] = potential_curvature<potential>(law, in[i]);
    load(out, k);
}

// Adds to slope and curvature the pair with the voxel just visited, weight times. Lange: both are multiplied by
// edge + |t| instead, so that one division does for the pair and the step.
template <Potential potential>
PALPATE_INLINE void add_pair(const Lanes& old, const float* other, float weight, const Law& law, Lanes& slope,
                             Lanes& curvature) {
    Lanes t, k;
    load(t, other);
    t = old - t;
    if constexpr (potential == Potential::lange) {
        choose(t < Lanes{}, -t, t, k);
        k += law.edge;
        weight *= law.edge;
        slope = slope * k + weight * t;
        curvature = curvature * k + weight;
    } else {
        curvature_at<potential>(law, t, k);
        k *= weight;
        slope += k * t;
        curvature += k;
    }
}

// Numerical kernel. fixed: the reach, or 0 for any.
template <Potential potential, int fixed>
PALPATE_INLINE void solve_with(const Solve& s, Line& line, int count, bool backwards, const Strip& strip,
                               Paraboloid& data, Lists::Scratch& scratch) {
    const int nx = int(s.neighbours.nx), reach = fixed ? fixed : line.reach;
    const float beside = s.neighbours.weight[1][1][0] * s.beta, beta = s.beta;
    const Law law = s.neighbours.law;
    const bool walked = !line.walks.empty(), listed = !s.lists.empty();
    const Lanes zero = {};
    for (int j = 0; j < count; j++) {
        const int i = backwards ? count - 1 - j : j, x = line.begin + i;
        float *f = line.f.data() + (i + 1) * lanes, *change = line.change.data() + (reach + i) * lanes;
        Lanes slope, curvature, old, moved, u, c;
        load(slope, line.slope.data() + i * lanes);
        load(curvature, line.coupling[0].data() + (reach + i) * lanes);
        for (int k = reach; k >= 1; k--) {
            load(c, line.coupling[k].data() + (reach + (backwards ? i : i - k)) * lanes);
            load(u, change + (backwards ? k : -k) * lanes);
            slope += c * u;
        }
        if (walked) measure(line.walks, x, slope, curvature);
        if (listed) s.lists.measure(strip, x, data, scratch, slope, curvature);
        load(old, f);
        if (beta > 0) {
            load(u, line.prior_slope.data() + i * lanes);
            load(c, line.prior_curvature.data() + i * lanes);
            slope += beta * u;
            curvature += beta * c;
            const bool bound = backwards ? x + 1 < nx : x > 0;
            add_pair<potential>(old, backwards ? f + lanes : f - lanes, bound ? beside : 0, law, slope, curvature);
        }
        moved = old - s.relaxation * slope / curvature;
        choose(moved > zero, moved, zero, moved);
        choose(curvature > zero, moved, old, moved); // else seen by no ray, tied to no neighbour
        store(f, moved);
        moved -= old;
        store(change, moved);
        if (walked) move(line.walks, moved);
        if (listed) s.lists.move(strip, moved, data, scratch);
    }
}

template <Potential potential>
PALPATE_INLINE void solve_reach(const Solve& s, Line& line, int count, bool backwards, const Strip& strip,
                                Paraboloid& data, Lists::Scratch& scratch) {
    switch (line.reach) {
    case 1:
        return solve_with<potential, 1>(s, line, count, backwards, strip, data, scratch);
    case 2:
        return solve_with<potential, 2>(s, line, count, backwards, strip, data, scratch);
    case 3:
        return solve_with<potential, 3>(s, line, count, backwards, strip, data, scratch);
    default:
        return solve_with<potential, 0>(s, line, count, backwards, strip, data, scratch);
    }
}

PALPATE_KERNEL void solve(const Solve& s, Line& line, int count, bool backwards, const Strip& strip, Paraboloid& data,
                          Lists::Scratch& scratch) {
    switch (s.neighbours.law.potential) {
    case Potential::quadratic:
        return solve_with<Potential::quadratic, 0>(s, line, count, backwards, strip, data, scratch);
    case Potential::huber:
        return solve_with<Potential::huber, 0>(s, line, count, backwards, strip, data, scratch);
    case Potential::lange:
        return solve_reach<Potential::lange>(s, line, count, backwards, strip, data, scratch);
    case Potential::hyperbola:
        return solve_with<Potential::hyperbola, 0>(s, line, count, backwards, strip, data, scratch);
    case Potential::generalised:
        return solve_with<Potential::generalised, 0>(s, line, count, backwards, strip, data, scratch);
    case Potential::tabulated:
        return solve_with<Potential::tabulated, 0>(s, line, count, backwards, strip, data, scratch);
    }
}

} // namespace

void Solve::along(Line& line, int count, bool backwards, const Strip& strip, Paraboloid& data,
                  Lists::Scratch& scratch) const {
    solve(*this, line, count, backwards, strip, data, scratch);
}

} // namespace palpate
