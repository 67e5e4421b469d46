#include "base/thread_pool.h"
#include <atomic>
#include <doctest.h>
#include <stdexcept>
#include <thread>
#include <vector>

using namespace palpate;

namespace {

struct ThreadCount {
    explicit ThreadCount(int n) { set_threads(n); }
    ~ThreadCount() { set_threads(0); }
};

} // namespace

TEST_CASE("parallel visits every index once, in one contiguous part a thread") {
    for (int n : {1, 2, 3, 4, 7}) {
        const ThreadCount set(n);
        CHECK(threads() == n);
        for (int count : {0, 1, 2, 3, 10, 1000}) {
            std::vector<int> visits(count);
            std::vector<std::atomic<int>> parts(n);
            parallel(count, [&](int64_t begin, int64_t end, int thread) {
                parts[thread]++;
                for (int64_t i = begin; i < end; i++) visits[i]++;
            });
            CHECK(visits == std::vector<int>(count, 1));
            for (const auto& part : parts) CHECK(part <= 1);
        }
    }
}

TEST_CASE("parallel_tasks runs every task once, each by a thread of its own number") {
    for (int n : {1, 2, 4}) {
        const ThreadCount set(n);
        std::vector<int> runs(500);
        std::vector<std::thread::id> who(n);
        std::atomic<int> mixed{0};
        parallel_tasks(500, [&](int64_t task, int thread) {
            runs[task]++;
            if (who[thread] == std::thread::id()) who[thread] = std::this_thread::get_id();
            mixed += who[thread] != std::this_thread::get_id();
        });
        CHECK(runs == std::vector<int>(500, 1));
        CHECK(mixed == 0);
    }
}

TEST_CASE("tasks start in order") {
    const ThreadCount set(3);
    std::atomic<int64_t> started{0};
    std::atomic<int> early{0};
    parallel_tasks(300, [&](int64_t task, int) { early += task > started++ + 2; });
    CHECK(early == 0);
}

TEST_CASE("a call from inside a part runs in the calling thread") {
    const ThreadCount set(4);
    std::vector<int> visits(4 * 25);
    std::atomic<int> elsewhere{0};
    parallel(4, [&](int64_t begin, int64_t end, int) {
        const auto self = std::this_thread::get_id();
        for (int64_t k = begin; k < end; k++)
            parallel(25, [&](int64_t from, int64_t to, int) {
                elsewhere += std::this_thread::get_id() != self;
                for (int64_t i = from; i < to; i++) visits[k * 25 + i]++;
            });
    });
    CHECK(visits == std::vector<int>(100, 1));
    CHECK(elsewhere == 0);
}

TEST_CASE("an exception in a part reaches the caller, and the pool works on") {
    const ThreadCount set(4);
    for (int failing = 0; failing < 4; failing++)
        CHECK_THROWS_AS(parallel(4,
                                 [&](int64_t begin, int64_t, int) {
                                     if (begin == failing) throw std::runtime_error("planted");
                                 }),
                        std::runtime_error);
    std::atomic<int> sum{0};
    parallel(100, [&](int64_t begin, int64_t end, int) { sum += int(end - begin); });
    CHECK(sum == 100);
}
