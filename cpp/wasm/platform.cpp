// What base/platform.cpp and base/thread_pool.cpp are elsewhere: one thread, and no system.
#include "base/platform.h"
#include "base/thread_pool.h"

namespace palpate {

void prefer_huge_pages(void*, size_t) {}
bool request_realtime_priority() { return false; }
void lower_thread_priority() {}
Semaphore::Semaphore() : handle(nullptr) {}
Semaphore::~Semaphore() = default;
void Semaphore::post() {}
bool Semaphore::wait(int64_t) { return false; }

int threads() { return 1; }
void set_threads(int) {}
void parallel(int64_t count, const std::function<void(int64_t, int64_t, int)>& work) {
    if (count > 0) work(0, count, 0);
}
void parallel_tasks(int64_t count, const std::function<void(int64_t, int)>& work) {
    for (int64_t task = 0; task < count; task++) work(task, 0);
}

} // namespace palpate

// A throw never reaches a catch in this module: what would throw is refused by `palpate export` before.
extern "C" {
void* __cxa_allocate_exception(size_t) { __builtin_trap(); }
void __cxa_throw(void*, void*, void (*)(void*)) { __builtin_trap(); }
}
