#pragma once
#include <cstdint>

namespace palpate {

// y[i] += sum over t of weight[t * n + i] * x[first[i] + t].
void add_taps(int n, int taps, const int32_t* first, const float* weight, const float* x, float* y);

} // namespace palpate
