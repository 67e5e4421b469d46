// Whether an array holds only finite numbers. Called once for every array that enters the package.
#pragma once
#include <cstdint>

namespace palpate {

// False if any value is infinite or not a number. In parallel over the array, without a copy.
bool all_finite(const float* values, int64_t size);

} // namespace palpate
