#pragma once
#include <atomic>

namespace palpate {

// The newest value, from one writer to one reader; neither ever waits. Two slots would not do: a slow reader would see
// a half-written value. Values have their full size from the start, so writing one allocates nothing.
template <class T> class Latest {
    static constexpr int fresh = 4; // set on `middle` while nobody has read it
    T slot[3];
    std::atomic<int> middle{1};
    int back = 0, front = 2;

public:
    explicit Latest(const T& first = T()) : slot{first, first, first} {}

    T& writing() { return slot[back]; }
    void publish() { back = middle.exchange(back | fresh, std::memory_order_acq_rel) & 3; }

    // True if `reading` will show a value that this reader has not seen.
    bool waiting() const { return middle.load(std::memory_order_relaxed) & fresh; }
    const T& reading() {
        if (waiting()) front = middle.exchange(front, std::memory_order_acq_rel) & 3;
        return slot[front];
    }
};

} // namespace palpate
