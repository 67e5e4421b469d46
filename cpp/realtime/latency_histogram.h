// A histogram of durations in steps of 10 us. The 1 kHz loop and the servo count their delays with it.
#pragma once
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <vector>

namespace palpate {

// Counts by steps of 10 us; the last bin counts all longer durations. One thread adds, any thread may read.
class LatencyHistogram {
    static constexpr int bins = 1001; // up to 10 ms
    std::atomic<int64_t> count[bins] = {};

public:
    static constexpr std::chrono::nanoseconds step{10000};
    void add(std::chrono::nanoseconds taken) {
        const auto bin = std::clamp<int64_t>(taken / step, 0, bins - 1);
        count[bin].store(count[bin].load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    }
    std::vector<int64_t> counts() const {
        std::vector<int64_t> out;
        for (const auto& c : count) out.push_back(c.load(std::memory_order_relaxed));
        return out;
    }
};

} // namespace palpate
