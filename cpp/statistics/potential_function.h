// Potential functions of the Markov random field prior, and the curvature of their parabola surrogates (Huber 1981).
// Inlined into the kernels of the prior, the coordinate descent and the memory gradient.
#pragma once
#include "base/vector_math.h"
#include <cmath>

namespace palpate {

// ψ(t) = δ² ψ₁(t/δ) of the difference t of two neighbours; δ is the edge. With s = |t|/δ, ψ₁ is
//   quadratic s²/2; huber s²/2 to s = 1, s − 1/2 beyond; lange s − log(1 + s); hyperbola √(1 + s²) − 1;
//   generalised s²/2 / (1 + s^(2−q)), which grows like |t|^q (Thibault et al., Med. Phys. 34:4526, 2007);
//   tabulated: a user's own, given by its weight ψ'(t)/t.
enum class Potential { quadratic, huber, lange, hyperbola, generalised, tabulated };

// The weight ψ'(t)/t of a user's potential, tabulated over s from 2^-octaves to 2^octaves, with `steps` entries for
// each doubling of s. It is linear between entries and constant outside. `value` is the exact integral of s·weight at
// the entries, so that the value of the objective matches its gradient.
struct PotentialTable {
    static constexpr int bits = 5, steps = 1 << bits, octaves = 16;
    static constexpr int size = steps * (2 * octaves) + 1;
    static constexpr int32_t first = (127 - octaves) << bits; // the leading bits of 2^-octaves as a float
    float weight[size], value[size];
};

// A potential as the kernels take it. edge: δ, 1/mm; exponent: q of the generalised one; table: of the tabulated one.
struct PotentialParameters {
    Potential potential = Potential::quadratic;
    float edge = 1, exponent = 2;
    const PotentialTable* table = nullptr;
};

struct TablePosition {
    int32_t index;
    float fraction; // of the way from there to the next entry
};

PALPATE_INLINE TablePosition table_position(float s) {
    constexpr float low = 1.0f / (1 << PotentialTable::octaves),
                    high = float(1 << PotentialTable::octaves) * (1 - 1e-7f);
    s = s > low ? s : low; // also what is no number
    s = s < high ? s : high;
    constexpr int rest = 23 - PotentialTable::bits;
    int32_t i = bits_of(s);
    return {(i >> rest) - PotentialTable::first, float(i & ((1 << rest) - 1)) * (1.0f / (1 << rest))};
}

// ψ'(t)/t: the curvature of the parabola that touches ψ at ±t and lies above it.
template <Potential potential> PALPATE_INLINE float potential_curvature(const PotentialParameters& law, float t) {
    float size = t < 0 ? -t : t, edge = law.edge;
    if constexpr (potential == Potential::lange) return edge / (edge + size);
    if constexpr (potential == Potential::huber) return size > edge ? edge / size : 1.0f;
    if constexpr (potential == Potential::hyperbola) return edge / std::sqrt(edge * edge + t * t);
    if constexpr (potential == Potential::generalised) {
        float u = fast_power(size * (1 / edge) + 1e-30f, 2 - law.exponent), one = 1 / (1 + u);
        return one * one * (1 + 0.5f * law.exponent * u);
    }
    if constexpr (potential == Potential::tabulated) {
        const TablePosition at = table_position(size * (1 / edge));
        const float* weight = law.table->weight;
        const float here = weight[at.index];
        return here + at.fraction * (weight[at.index + 1] - here);
    }
    return 1.0f;
}

// function<potential>(...) for a potential known only at run time, as a macro: a lambda would lose the kernel's target.
#define PALPATE_POTENTIAL_CASE(name, function, ...)                                                                    \
    case Potential::name:                                                                                              \
        return function<Potential::name>(__VA_ARGS__);
#define PALPATE_RETURN_FOR_POTENTIAL(potential, function, ...)                                                         \
    switch (potential) {                                                                                               \
        PALPATE_POTENTIAL_CASE(quadratic, function, __VA_ARGS__)                                                       \
        PALPATE_POTENTIAL_CASE(huber, function, __VA_ARGS__)                                                           \
        PALPATE_POTENTIAL_CASE(lange, function, __VA_ARGS__)                                                           \
        PALPATE_POTENTIAL_CASE(hyperbola, function, __VA_ARGS__)                                                       \
        PALPATE_POTENTIAL_CASE(generalised, function, __VA_ARGS__)                                                     \
        PALPATE_POTENTIAL_CASE(tabulated, function, __VA_ARGS__)                                                       \
    }

// The same for a potential known only at run time; too slow for a hot loop.
PALPATE_INLINE float potential_curvature(const PotentialParameters& law, float t) {
    PALPATE_RETURN_FOR_POTENTIAL(law.potential, potential_curvature, law, t);
    return 1.0f;
}

} // namespace palpate
