#pragma once
#include "lanes.h"
#include "quad.h"

namespace palpate {

// Eight doubles side by side.
struct Octet {
    Quad low, high;
};

// Eight numbers side by side, and how many such rows the registers hold at a time beside what comes in.
template <class T> struct Vector;
template <> struct Vector<float> {
    using type = Lanes;
    static constexpr int rows = 8;
};
template <> struct Vector<double> {
    using type = Octet;
    static constexpr int rows = 4;
};
PALPATE_INLINE void load(Octet& v, const double* p) { load(v.low, p), load(v.high, p + 4); }
PALPATE_INLINE void store(double* p, const Octet& v) { store(p, v.low), store(p + 4, v.high); }
PALPATE_INLINE void add(Octet& v, double f, const Octet& x) { v.low += f * x.low, v.high += f * x.high; }
PALPATE_INLINE void add(Lanes& v, float f, const Lanes& x) { v += f * x; }
PALPATE_INLINE void take(Octet& v, double f, const Octet& x) { v.low -= f * x.low, v.high -= f * x.high; }
PALPATE_INLINE void take(Lanes& v, float f, const Lanes& x) { v -= f * x; }
PALPATE_INLINE void multiply(Octet& v, const Octet& x) { v.low *= x.low, v.high *= x.high; }
PALPATE_INLINE void multiply(Lanes& v, const Lanes& x) { v *= x; }
PALPATE_INLINE void plus(Octet& v, const Octet& x) { v.low += x.low, v.high += x.high; }
PALPATE_INLINE void plus(Lanes& v, const Lanes& x) { v += x; }
PALPATE_INLINE double sum(const Octet& v) { return total(v.low + v.high); }
PALPATE_INLINE float sum(const Lanes& v) { return total(v); }

} // namespace palpate
