// A vector of floats that starts at a cache line (64 bytes), for the kernels' tables and tiles.
#pragma once
#include <cstddef>
#include <new>
#include <vector>

namespace palpate {

constexpr int cache_line = 16; // floats

// Aligned so that no SIMD vector lies across two cache lines.
template <class T> struct CacheAlignedAllocator {
    using value_type = T;
    CacheAlignedAllocator() = default;
    template <class U> CacheAlignedAllocator(const CacheAlignedAllocator<U>&) {}
    T* allocate(size_t n) { return static_cast<T*>(::operator new(n * sizeof(T), std::align_val_t(64))); }
    void deallocate(T* p, size_t) { ::operator delete(p, std::align_val_t(64)); }
    bool operator==(const CacheAlignedAllocator&) const { return true; }
    bool operator!=(const CacheAlignedAllocator&) const { return false; }
};
using AlignedBuffer = std::vector<float, CacheAlignedAllocator<float>>;

} // namespace palpate
