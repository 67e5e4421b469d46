#include "base/thread_pool.h"
#include "base/platform.h"
#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdlib>
#include <exception>
#include <memory>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace palpate {
namespace {

thread_local bool inside = false; // this thread runs a part

// Threads wait here between calls, since starting or waking a thread costs more than a small kernel. The next call
// mostly follows soon: a waiting thread first spins for about 50 µs, yielding to any thread that has work, then sleeps.
class Pool {
    std::vector<std::thread> workers;
    std::mutex mutex;
    std::condition_variable wake, finished;
    const std::function<void(int)>* job = nullptr;
    int wanted = 0;
    std::atomic<int64_t> round{0};
    std::atomic<int> running{0};
    std::atomic<bool> stopping{false};

    template <class Done> static void spin_until(Done done) {
        for (int i = 0; i < 150 && !done(); i++) std::this_thread::yield();
    }
    void wait_for_work(int index) {
        inside = true;
        for (int64_t seen = 0;;) {
            const auto called = [&] { return stopping || round != seen; };
            spin_until(called);
            std::unique_lock lock(mutex);
            wake.wait(lock, called);
            if (stopping) return;
            seen = round;
            if (index >= wanted) continue;
            const auto* mine = job;
            lock.unlock();
            (*mine)(index);
            if (--running > 0) continue;
            lock.lock(); // not between the caller's check and its sleep
            finished.notify_one();
        }
    }

public:
    const int owner = process_id(); // threads do not survive a fork
    const int asked;

    explicit Pool(int asked) : asked(asked) {
        workers.reserve(asked);
        try {
            for (int i = 1; i < asked; i++) workers.emplace_back([this, i] { wait_for_work(i); });
        } catch (const std::system_error&) { // the system gives no more threads: those that there are do the work
        }
    }
    int size() const { return int(workers.size()) + 1; } // the caller's too
    ~Pool() {
        {
            std::lock_guard lock(mutex);
            stopping = true;
        }
        wake.notify_all();
        for (auto& worker : workers) worker.join();
    }
    void run(int parts, const std::function<void(int)>& part) {
        {
            std::lock_guard lock(mutex);
            job = &part;
            wanted = parts;
            running = parts - 1;
            round++;
        }
        wake.notify_all();
        inside = true;
        part(0);
        inside = false;
        const auto done = [&] { return running == 0; };
        spin_until(done);
        if (done()) return;
        std::unique_lock lock(mutex);
        finished.wait(lock, done);
    }
};

constexpr int most_threads = 1024;

std::mutex pool_mutex; // held by the one call that uses the pool
Pool* pool = nullptr;
int chosen = 0;

int default_threads() {
    const char* setting = std::getenv("PALPATE_THREADS");
    int n = setting ? std::atoi(setting) : 0;
    return n > 0 ? std::min(n, most_threads) : std::max(1u, std::thread::hardware_concurrency());
}

} // namespace

int threads() {
    static const int automatic = default_threads();
    return chosen > 0 ? chosen : automatic;
}

void set_threads(int n) {
    std::lock_guard lock(pool_mutex);
    chosen = std::clamp(n, 0, most_threads);
}

void parallel(int64_t count, const std::function<void(int64_t, int64_t, int)>& work) {
    if (count <= 0) return;
    int parts = int(std::min<int64_t>(count, threads()));
    std::unique_lock lock(pool_mutex, std::defer_lock);
    if (parts == 1 || inside || !lock.try_lock()) return work(0, count, 0);
    if (pool && pool->owner != process_id()) pool = nullptr; // a forked child: the parent's threads are not here
    if (!pool || pool->asked < parts) {
        delete pool;
        pool = nullptr;
        pool = new Pool(parts);
    }
    parts = std::min(parts, pool->size());
    std::exception_ptr thrown;
    std::mutex catching;
    pool->run(parts, [&](int i) {
        try {
            work(count * i / parts, count * (i + 1) / parts, i);
        } catch (...) {
            std::lock_guard one_at_a_time(catching);
            thrown = std::current_exception();
        }
    });
    if (thrown) std::rethrow_exception(thrown);
}

void parallel_tasks(int64_t count, const std::function<void(int64_t, int)>& work) {
    std::atomic<int64_t> next{0};
    parallel(std::min<int64_t>(count, threads()), [&](int64_t, int64_t, int thread) {
        for (int64_t task; (task = next.fetch_add(1, std::memory_order_relaxed)) < count;) work(task, thread);
    });
}

} // namespace palpate
