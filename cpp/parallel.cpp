#include "parallel.h"
#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <thread>
#include <unistd.h>
#include <vector>

namespace palpate {
namespace {

thread_local bool inside = false; // this thread is already running a part

// Threads wait here between calls: starting them anew costs more than a small kernel, and so does waking them. The next
// call mostly follows soon, so whoever waits stays awake for some 50 µs, and gives way to any thread that has work.
class Pool {
    std::vector<std::thread> workers;
    std::mutex mutex;
    std::condition_variable wake, finished;
    const std::function<void(int)>* job = nullptr;
    int wanted = 0;
    std::atomic<int64_t> round{0};
    std::atomic<int> running{0};
    std::atomic<bool> stopping{false};

    template <class Done> static void stay_awake(Done done) {
        for (int looks = 0; looks < 150 && !done(); looks++) std::this_thread::yield();
    }
    void wait_for_work(int index) {
        inside = true;
        for (int64_t seen = 0;;) {
            const auto called = [&] { return stopping || round != seen; };
            stay_awake(called);
            std::unique_lock lock(mutex);
            wake.wait(lock, called);
            if (stopping) return;
            seen = round;
            if (index >= wanted) continue;
            const auto* mine = job;
            lock.unlock();
            (*mine)(index);
            if (--running > 0) continue;
            lock.lock(); // not between the other's last look and its sleep
            finished.notify_one();
        }
    }

public:
    const pid_t owner = getpid(); // threads do not survive a fork
    const int size;

    explicit Pool(int size) : size(size) {
        for (int i = 1; i < size; i++) workers.emplace_back([this, i] { wait_for_work(i); });
    }
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
        stay_awake(done);
        if (done()) return;
        std::unique_lock lock(mutex);
        finished.wait(lock, done);
    }
};

std::mutex gate; // one parallel call at a time; a second caller (another Python thread) runs alone
Pool* pool = nullptr;
int chosen = 0;

int default_threads() {
    const char* wish = std::getenv("PALPATE_THREADS");
    int n = wish ? std::atoi(wish) : 0;
    return n > 0 ? n : std::max(1u, std::thread::hardware_concurrency());
}

} // namespace

int threads() {
    static const int automatic = default_threads();
    return chosen > 0 ? chosen : automatic;
}

void set_threads(int n) {
    std::lock_guard lock(gate);
    chosen = std::max(0, n);
}

void parallel(int64_t count, const std::function<void(int64_t, int64_t, int)>& work) {
    if (count <= 0) return;
    int parts = int(std::min<int64_t>(count, threads()));
    std::unique_lock lock(gate, std::defer_lock);
    if (parts == 1 || inside || !lock.try_lock()) return work(0, count, 0);
    if (pool && pool->owner != getpid()) pool = nullptr; // a forked child: the parent's threads are not here
    if (!pool || pool->size < parts) {
        delete pool;
        pool = new Pool(parts);
    }
    pool->run(parts, [&](int i) { work(count * i / parts, count * (i + 1) / parts, i); });
}

void parallel_tasks(int64_t count, const std::function<void(int64_t, int)>& work) {
    std::atomic<int64_t> next{0};
    parallel(std::min<int64_t>(count, threads()), [&](int64_t, int64_t, int thread) {
        for (int64_t task; (task = next.fetch_add(1, std::memory_order_relaxed)) < count;) work(task, thread);
    });
}

} // namespace palpate
