#pragma once
#include "lanes.h"
#include "quad.h"

namespace palpate {

// Four floats in one register: a node's x, y, z and a lane that stays zero.
typedef float Four __attribute__((vector_size(16)));
typedef float FourAnywhere __attribute__((vector_size(16), aligned(4), may_alias)); // read in place: no copy by memory
PALPATE_INLINE void load(Four& v, const float* p) { v = *reinterpret_cast<const FourAnywhere*>(p); }
PALPATE_INLINE void store(float* p, const Four& v) { *reinterpret_cast<FourAnywhere*>(p) = v; }
PALPATE_INLINE void widen(const Four& v, Quad& out) { out = __builtin_convertvector(v, Quad); }
PALPATE_INLINE void narrow(const Quad& v, Four& out) { out = __builtin_convertvector(v, Four); }
PALPATE_INLINE void join(const float* low, const float* high, Lanes& out) {
    Four a, b;
    load(a, low), load(b, high);
    out = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
}
// Each lane in all four.
PALPATE_INLINE void broadcast(const Four& v, Four& x, Four& y, Four& z) {
    x = __builtin_shufflevector(v, v, 0, 0, 0, 0);
    y = __builtin_shufflevector(v, v, 1, 1, 1, 1);
    z = __builtin_shufflevector(v, v, 2, 2, 2, 2);
}
PALPATE_INLINE void broadcast(const Four& v, Lanes& x, Lanes& y, Lanes& z) {
    x = __builtin_shufflevector(v, v, 0, 0, 0, 0, 0, 0, 0, 0);
    y = __builtin_shufflevector(v, v, 1, 1, 1, 1, 1, 1, 1, 1);
    z = __builtin_shufflevector(v, v, 2, 2, 2, 2, 2, 2, 2, 2);
}

} // namespace palpate
