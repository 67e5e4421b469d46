#pragma once
#include <cstdint>

namespace palpate {

// Whether no value is infinite or not a number.
bool all_finite(const float* values, int64_t size);

} // namespace palpate
