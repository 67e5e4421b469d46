#pragma once
#include <cstdint>
#include <functional>

namespace palpate {

// Number of threads that parallel() uses: PALPATE_THREADS, else one a core, until set_threads(n > 0) says otherwise.
int threads();
void set_threads(int n);

// Calls work(begin, end, thread) on contiguous parts of 0..count, one part a thread. Parts own disjoint outputs, so the
// result cannot depend on who runs which. Calls from inside a part run inline.
void parallel(int64_t count, const std::function<void(int64_t begin, int64_t end, int thread)>& work);

// Calls work(task, thread) for each task 0..count, in order, each on whichever thread is free next: for tasks of unequal
// length that own disjoint outputs, neighbours of which share what they read.
void parallel_tasks(int64_t count, const std::function<void(int64_t task, int thread)>& work);

} // namespace palpate
