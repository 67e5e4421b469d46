// An array of floats on huge pages, for images and volumes that are visited row by row, many rows apart.
#pragma once
#include "base/platform.h"
#include <cstdint>
#include <memory>
#include <new>

namespace palpate {

// Uninitialised. On small pages, such access spends its time on page faults and address translation. Where the system
// has no huge pages, ordinary ones.
class HugePageBuffer {
    static constexpr size_t page = size_t(2) << 20;
    struct Free {
        void operator()(float* p) const { ::operator delete(p, std::align_val_t(page)); }
    };
    std::unique_ptr<float[], Free> memory;

public:
    HugePageBuffer() = default;
    explicit HugePageBuffer(int64_t size) {
        const size_t bytes = (size * sizeof(float) + page - 1) / page * page;
        memory.reset(static_cast<float*>(::operator new(bytes, std::align_val_t(page))));
        prefer_huge_pages(memory.get(), bytes);
    }
    float* data() { return memory.get(); }
    const float* data() const { return memory.get(); }
};

} // namespace palpate
