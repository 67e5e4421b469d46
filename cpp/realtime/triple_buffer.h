// The newest value from one writing thread to one reading thread; neither ever waits (a triple buffer).
// The 1 kHz loop publishes frames with it, devices their poses, the servo its contacts.
#pragma once
#include <atomic>

namespace palpate {

// Three slots: one belongs to the writer, one to the reader, the third holds the newest value. With two, a slow reader
// would see a half-written value. All slots start with the size of `first`, so that writing allocates nothing.
template <class T> class TripleBuffer {
    static constexpr int unread = 4; // set in `middle` until the reader takes its slot
    T slot[3];
    std::atomic<int> middle{1};
    int back = 0, front = 2;

public:
    explicit TripleBuffer(const T& first = T()) : slot{first, first, first} {}

    T& write_slot() { return slot[back]; }
    void publish() { back = middle.exchange(back | unread, std::memory_order_acq_rel) & 3; }

    // Whether `latest` will return a value that this reader has not seen.
    bool has_new() const { return middle.load(std::memory_order_relaxed) & unread; }
    const T& latest() {
        if (has_new()) front = middle.exchange(front, std::memory_order_acq_rel) & 3;
        return slot[front];
    }
};

} // namespace palpate
