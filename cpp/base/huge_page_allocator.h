// The memory of large arrays on huge pages, for vectors that are written once and then read at random.
#pragma once
#include "base/platform.h"
#include <new>
#include <utility>

namespace palpate {

// Elements are not set to zero when they are made without a value. On small pages a factorisation meets a page fault
// every 4 KiB. Where the system has no huge pages, and in small arrays, ordinary ones.
template <class T> struct HugePageAllocator {
    using value_type = T;
    HugePageAllocator() = default;
    template <class U> HugePageAllocator(const HugePageAllocator<U>&) {}
    T* allocate(size_t n) {
        const size_t bytes = padded(n);
        void* memory = ::operator new(bytes, alignment(n));
        if (is_large(n)) prefer_huge_pages(memory, bytes);
        return static_cast<T*>(memory);
    }
    void deallocate(T* p, size_t n) { ::operator delete(p, alignment(n)); }
    template <class U> void construct(U* p) { ::new (static_cast<void*>(p)) U; }
    template <class U, class... Values> void construct(U* p, Values&&... values) {
        ::new (static_cast<void*>(p)) U(std::forward<Values>(values)...);
    }
    bool operator==(const HugePageAllocator&) const { return true; }
    bool operator!=(const HugePageAllocator&) const { return false; }

private:
    static constexpr size_t page = size_t(2) << 20, line = 64;
    static bool is_large(size_t n) { return may_have_huge_pages && n * sizeof(T) >= page; }
    static size_t padded(size_t n) { return is_large(n) ? (n * sizeof(T) + page - 1) / page * page : n * sizeof(T); }
    static std::align_val_t alignment(size_t n) { return std::align_val_t(is_large(n) ? page : line); }
};

} // namespace palpate
