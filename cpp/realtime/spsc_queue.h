// Every value, in order, from one writing thread to one reading thread (a single-producer single-consumer queue).
// The 1 kHz loop writes its record with it; another thread drains it.
#pragma once
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace palpate {

// A ring buffer of fixed capacity. When it is full, a new value is dropped and counted: the writer never waits.
template <class T> class SpscQueue {
    std::vector<T> slot;
    std::atomic<size_t> written{0}, taken{0};
    std::atomic<int64_t> lost{0};

public:
    explicit SpscQueue(size_t capacity) : slot(capacity) {}

    void push(const T& value) {
        size_t at = written.load(std::memory_order_relaxed);
        if (at - taken.load(std::memory_order_acquire) == slot.size()) {
            lost.fetch_add(1, std::memory_order_relaxed);
            return;
        }
        slot[at % slot.size()] = value;
        written.store(at + 1, std::memory_order_release);
    }

    // Appends to `out` all values pushed since the last call.
    void drain(std::vector<T>& out) {
        size_t end = written.load(std::memory_order_acquire), at = taken.load(std::memory_order_relaxed);
        for (; at != end; at++) out.push_back(slot[at % slot.size()]);
        taken.store(at, std::memory_order_release);
    }

    int64_t dropped() const { return lost.load(std::memory_order_relaxed); }
};

} // namespace palpate
