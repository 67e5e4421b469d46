#pragma once
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>
#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace palpate {

// Floats of no value in large pages, where the system has them: images that are visited row by row, many rows apart,
// would otherwise spend their time on page faults and on translating addresses.
class Pages {
    struct Free {
        void operator()(float* p) const { std::free(p); }
    };
    std::unique_ptr<float[], Free> memory;

public:
    Pages() = default;
    explicit Pages(int64_t size) {
        constexpr size_t page = size_t(2) << 20;
        const size_t bytes = (size * sizeof(float) + page - 1) / page * page;
        memory.reset(static_cast<float*>(std::aligned_alloc(page, bytes)));
        if (!memory) throw std::bad_alloc();
#if defined(__linux__)
        madvise(memory.get(), bytes, MADV_HUGEPAGE);
#endif
    }
    float* data() { return memory.get(); }
    const float* data() const { return memory.get(); }
};

} // namespace palpate
