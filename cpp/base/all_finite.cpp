#include "base/all_finite.h"
#include "base/cpu_dispatch.h"
#include "base/thread_pool.h"
#include <algorithm>
#include <atomic>
#include <cstring>

namespace palpate {

// Infinities and NaNs have an exponent of all ones: with the sign shifted out they are the largest numbers.
PALPATE_KERNEL uint32_t largest_bits(const float* values, int64_t size) {
    uint32_t largest = 0;
    for (int64_t i = 0; i < size; i++) {
        uint32_t bits;
        std::memcpy(&bits, values + i, sizeof bits);
        largest = std::max(largest, bits << 1);
    }
    return largest;
}

bool all_finite(const float* values, int64_t size) {
    constexpr int64_t block = 1 << 16;
    std::atomic<bool> finite{true};
    parallel((size + block - 1) / block, [&](int64_t begin, int64_t end, int) {
        for (int64_t i = begin; i < end && finite.load(std::memory_order_relaxed); i++)
            if (largest_bits(values + i * block, std::min(block, size - i * block)) >= 0xff000000u)
                finite.store(false, std::memory_order_relaxed);
    });
    return finite;
}

} // namespace palpate
