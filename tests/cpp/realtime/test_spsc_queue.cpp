#include "realtime/spsc_queue.h"
#include <array>
#include <atomic>
#include <doctest.h>
#include <numeric>
#include <thread>

using palpate::SpscQueue;

TEST_CASE("a queue gives back every value in order, across the end of its memory") {
    SpscQueue<int> queue(5);
    std::vector<int> out, all(60);
    std::iota(all.begin(), all.end(), 0);
    for (int next = 0, round = 0; next < 60; round++) {
        for (int i = 0; i < round % 5 + 1 && next < 60; i++) queue.push(next++);
        queue.drain(out);
        REQUIRE(int(out.size()) == next);
    }
    CHECK(out == all);
    CHECK(queue.dropped() == 0);
    queue.drain(out);
    CHECK(out == all);
}

TEST_CASE("a full queue keeps what it has, and counts what it drops") {
    SpscQueue<int> queue(4);
    std::vector<int> out;
    for (int i = 0; i < 10; i++) queue.push(i);
    CHECK(queue.dropped() == 6);
    queue.drain(out);
    CHECK(out == std::vector<int>{0, 1, 2, 3});
    for (int i = 10; i < 14; i++) queue.push(i);
    CHECK(queue.dropped() == 6);
    queue.drain(out);
    CHECK(out == std::vector<int>{0, 1, 2, 3, 10, 11, 12, 13});
}

// Every value is a row of equal numbers: a row of different ones was read while it was written.
TEST_CASE("two threads: no torn value, order kept, every value delivered or counted as dropped") {
    constexpr int count = 50000;
    using Row = std::array<int, 500>; // large: the two threads are often at the same slots
    SpscQueue<Row> queue(4);
    std::atomic<bool> done{false};
    std::thread writer([&] {
        Row row;
        for (int i = 0; i < count; i++) {
            row.fill(i);
            queue.push(row);
        }
        done = true;
    });
    int torn = 0, disordered = 0, last = -1;
    int64_t taken = 0;
    std::vector<Row> out;
    for (bool more = true; more;) {
        more = !done;
        out.clear();
        queue.drain(out);
        for (const Row& row : out) {
            for (int value : row) torn += value != row[0];
            disordered += row[0] <= last;
            last = row[0];
        }
        taken += int64_t(out.size());
    }
    writer.join();
    CHECK(torn == 0);
    CHECK(disordered == 0);
    CHECK(taken + queue.dropped() == count);
}
