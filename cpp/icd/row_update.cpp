#include "icd/row_update.h"

namespace palpate {
namespace {

// ψ'(t)/t of eight pairs.
template <Potential potential>
PALPATE_INLINE void curvature_at(const PotentialParameters& law, const f32x8& t, f32x8& out) {
    float in[lanes], k[lanes];
    store(in, t);
    for (int i = 0; i < lanes; i++) k[i] = potential_curvature<potential>(law, in[i]);
    load(out, k);
}

// Adds to slope and curvature the pair with the voxel updated just before, weight times. Lange: both are multiplied by
// edge + |t| instead, so that one division does for the pair and the step.
template <Potential potential>
PALPATE_INLINE void add_pair(const f32x8& old, const float* other, float weight, const PotentialParameters& law,
                             f32x8& slope, f32x8& curvature) {
    f32x8 t, k;
    load(t, other);
    t = old - t;
    if constexpr (potential == Potential::lange) {
        choose(t < f32x8{}, -t, t, k);
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

template <Potential potential>
PALPATE_INLINE void update_with(const RowUpdate& s, GroupPart& part, int count, bool backwards, const RowGroup& group,
                                SurrogateImages& data) {
    const int nx = int(s.neighbours.nx);
    const float previous_weight = s.neighbours.weight[1][1][0] * s.beta, beta = s.beta;
    const PotentialParameters law = s.neighbours.law;
    const f32x8 zero = {};
    for (int j = 0; j < count; j++) {
        const int i = backwards ? count - 1 - j : j, x = part.begin + i;
        float* f = part.f.data() + (i + 1) * lanes;
        f32x8 slope = {}, curvature = {}, old, updated, u, c;
        add_derivatives(part.columns, x, slope, curvature);
        if (!s.footprints.empty()) s.footprints.add_derivatives(group, x, data, part.footprints, slope, curvature);
        load(old, f);
        if (beta > 0) {
            load(u, part.prior_slope.data() + i * lanes);
            load(c, part.prior_curvature.data() + i * lanes);
            slope += beta * u;
            curvature += beta * c;
            const bool inside = backwards ? x + 1 < nx : x > 0;
            add_pair<potential>(old, backwards ? f + lanes : f - lanes, inside ? previous_weight : 0, law, slope,
                                curvature);
        }
        updated = old - s.relaxation * slope / curvature;
        choose(updated > zero, updated, zero, updated);
        choose(curvature > zero, updated, old, updated); // else no ray and no neighbour determines it
        if (s.bounded) {
            load(u, part.inside.data() + i * lanes);
            choose(u > zero, updated, zero, updated);
        }
        store(f, updated);
        updated -= old;
        apply_change(part.columns, x, updated);
        if (!s.footprints.empty()) s.footprints.apply_change(group, updated, data, part.footprints);
    }
}

PALPATE_KERNEL void update_part(const RowUpdate& s, GroupPart& part, int count, bool backwards, const RowGroup& group,
                                SurrogateImages& data) {
    PALPATE_RETURN_FOR_POTENTIAL(s.neighbours.law.potential, update_with, s, part, count, backwards, group, data);
}

} // namespace

void RowUpdate::update(GroupPart& part, int count, bool backwards, const RowGroup& group, SurrogateImages& data) const {
    update_part(*this, part, count, backwards, group, data);
}

} // namespace palpate
