// Non-temporal copies: data go to memory without passing through the cache. Used by the backprojection.
#pragma once
#include "base/aligned_buffer.h"
#include <algorithm>
#include <cstdint>
#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

namespace palpate {

// Copies n floats that are not read again soon. The cache then need not fetch the lines that they overwrite. Call
// streaming_fence before another thread may read them.
inline void streaming_copy(const float* from, int n, float* to) {
#if defined(__SSE2__)
    constexpr int line = cache_line, four = 4;
    int i = 0;
    for (; i < n && reinterpret_cast<uintptr_t>(to + i) % (line * sizeof(float)) != 0; i++) to[i] = from[i];
    for (; i + line <= n; i += line)
        for (int k = i; k < i + line; k += four) _mm_stream_ps(to + k, _mm_loadu_ps(from + k));
    for (; i < n; i++) to[i] = from[i];
#else
    std::copy_n(from, n, to);
#endif
}

inline void streaming_fence() {
#if defined(__SSE2__)
    _mm_sfence();
#endif
}

} // namespace palpate
