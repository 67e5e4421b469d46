#pragma once
#include "elementary.h"
#include <cmath>

namespace palpate {

// ψ(t) = δ² ψ₁(t/δ) of a difference t between neighbours; δ is the edge. With s = |t|/δ:
//   quadratic s²/2; huber s²/2 to s = 1, s − 1/2 beyond; lange s − log(1 + s); hyperbola √(1 + s²) − 1;
//   generalised s²/2 / (1 + s^(2−q)), which grows like |t|^q (Thibault et al., Med. Phys. 34:4526, 2007);
//   tabulated: any other, by its weight.
enum class Potential { quadratic, huber, lange, hyperbola, generalised, tabulated };

// The weight ψ'(t)/t of a potential of the user's own, tabulated over s: `steps` a doubling of s, from 2^-octaves
// to 2^octaves, with the weight linear in s in between, and constant outside. `value` is the exact integral of
// s·weight at the same points, so that the objective and its slope are of one function.
struct Table {
    static constexpr int bits = 5, steps = 1 << bits, octaves = 16;
    static constexpr int size = steps * (2 * octaves) + 1;
    static constexpr int32_t first = (127 - octaves) << bits; // the leading bits of the float 2^-octaves
    float weight[size], value[size];
};

// A potential as the kernels take it. edge: δ, 1/mm; exponent: q of the generalised one; table: of the tabulated one.
struct Law {
    Potential potential = Potential::quadratic;
    float edge = 1, exponent = 2;
    const Table* table = nullptr;
};

struct Place {
    int32_t index;
    float share; // of the way to the next entry
};

PALPATE_INLINE Place place(float s) {
    constexpr float low = 1.0f / (1 << Table::octaves), high = float(1 << Table::octaves) * (1 - 1e-7f);
    s = s < low ? low : s > high ? high : s;
    constexpr int rest = 23 - Table::bits;
    int32_t i = bits_of(s);
    return {(i >> rest) - Table::first, float(i & ((1 << rest) - 1)) * (1.0f / (1 << rest))};
}

// ψ'(t)/t, so ψ'(t) = t·weight; the curvature of the parabola through ψ at ±t that stays above it (Huber 1981).
template <Potential potential> PALPATE_INLINE float potential_curvature(const Law& law, float t) {
    float size = t < 0 ? -t : t, edge = law.edge;
    if constexpr (potential == Potential::lange) return edge / (edge + size);
    if constexpr (potential == Potential::huber) return size > edge ? edge / size : 1.0f;
    if constexpr (potential == Potential::hyperbola) return edge / std::sqrt(edge * edge + t * t);
    if constexpr (potential == Potential::generalised) {
        float u = fast_power(size * (1 / edge) + 1e-30f, 2 - law.exponent), one = 1 / (1 + u);
        return one * one * (1 + 0.5f * law.exponent * u);
    }
    if constexpr (potential == Potential::tabulated) {
        Place at = place(size * (1 / edge));
        const float* weight = law.table->weight;
        const float here = weight[at.index];
        return here + at.share * (weight[at.index + 1] - here);
    }
    return 1.0f;
}

// The same where the potential is known only now: for a few values, not for a hot loop.
PALPATE_INLINE float potential_curvature(const Law& law, float t) {
    switch (law.potential) {
    case Potential::lange:
        return potential_curvature<Potential::lange>(law, t);
    case Potential::huber:
        return potential_curvature<Potential::huber>(law, t);
    case Potential::hyperbola:
        return potential_curvature<Potential::hyperbola>(law, t);
    case Potential::generalised:
        return potential_curvature<Potential::generalised>(law, t);
    case Potential::tabulated:
        return potential_curvature<Potential::tabulated>(law, t);
    case Potential::quadratic:
        break;
    }
    return 1.0f;
}

} // namespace palpate
