// Included before every file of the engine in a browser (`make wasm`): WebAssembly has one thread here, and the C++
// library has none of the names below. A thread that is started does nothing: engine.cpp does its work between ticks.
#pragma once
#include <chrono>

namespace std {

class thread {
public:
    thread() = default;
    template <class... Anything> explicit thread(Anything&&...) {}
    bool joinable() const { return false; }
    void join() {}
    static unsigned hardware_concurrency() { return 1; }
};

namespace this_thread {
inline void yield() {}
template <class Anything> void sleep_for(const Anything&) {}
template <class Anything> void sleep_until(const Anything&) {}
} // namespace this_thread

} // namespace std
