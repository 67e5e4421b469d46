#pragma once
#include <cstdlib>
#include <new>
#include <vector>

namespace palpate {

constexpr int cache_line = 16; // floats

// Floats that begin at a cache line, so that no vector lies across two.
template <class T> struct CacheAligned {
    using value_type = T;
    CacheAligned() = default;
    template <class U> CacheAligned(const CacheAligned<U>&) {}
    T* allocate(size_t n) {
        void* p = std::aligned_alloc(64, (n * sizeof(T) + 63) / 64 * 64);
        if (!p) throw std::bad_alloc();
        return static_cast<T*>(p);
    }
    void deallocate(T* p, size_t) { std::free(p); }
    bool operator==(const CacheAligned&) const { return true; }
    bool operator!=(const CacheAligned&) const { return false; }
};
using Buffer = std::vector<float, CacheAligned<float>>;

} // namespace palpate
