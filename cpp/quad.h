#pragma once
#include "dispatch.h"
#include <cstring>

namespace palpate {

// Four doubles in one register (or two).
typedef double Quad __attribute__((vector_size(32)));
PALPATE_INLINE void load(Quad& v, const double* p) { std::memcpy(&v, p, sizeof v); }
PALPATE_INLINE void store(double* p, const Quad& v) { std::memcpy(p, &v, sizeof v); }
PALPATE_INLINE double total(const Quad& v) { return (v[0] + v[2]) + (v[1] + v[3]); }

} // namespace palpate
