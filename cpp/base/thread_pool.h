// The thread pool of all kernels: parallel loops over ranges and tasks.
// Called from any thread; one call at a time uses the pool, a second one meanwhile runs on its own thread alone.
#pragma once
#include <cstdint>
#include <functional>

namespace palpate {

// The number of threads that parallel() uses: set_threads(n > 0), else the environment's PALPATE_THREADS, else one a
// core; at most 1024. Where the system gives fewer, those do the work.
int threads();
void set_threads(int n);

// Calls work(begin, end, thread) on contiguous parts of 0..count, one part a thread. Parts must write disjoint outputs;
// then the result does not depend on the number of threads. A call from inside a part runs on its own thread alone. An
// exception in a part is thrown again here, after all parts have ended.
void parallel(int64_t count, const std::function<void(int64_t begin, int64_t end, int thread)>& work);

// Calls work(task, thread) for each task 0..count: tasks start in order, each on the next thread that is free. For
// tasks of unequal length that write disjoint outputs.
void parallel_tasks(int64_t count, const std::function<void(int64_t task, int thread)>& work);

} // namespace palpate
