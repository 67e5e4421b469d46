#pragma once
#include "buffer.h"
#include <algorithm>
#include <cstdint>
#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

namespace palpate {

// Copies n floats to where they are not read again soon: past the cache, which need not fetch the lines that they fill.
// What other threads read then waits for `streamed`.
inline void stream(const float* from, int n, float* to) {
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

inline void streamed() {
#if defined(__SSE2__)
    _mm_sfence();
#endif
}

} // namespace palpate
