#include "realtime/triple_buffer.h"
#include <array>
#include <doctest.h>
#include <thread>

using palpate::TripleBuffer;

TEST_CASE("a triple buffer shows its first value until one is published") {
    TripleBuffer<int> buffer(7);
    CHECK_FALSE(buffer.has_new());
    CHECK(buffer.latest() == 7);
    buffer.write_slot() = 8;
    CHECK_FALSE(buffer.has_new());
    CHECK(buffer.latest() == 7);
    buffer.publish();
    CHECK(buffer.has_new());
    CHECK(buffer.latest() == 8);
    CHECK_FALSE(buffer.has_new());
    CHECK(buffer.latest() == 8);
}

TEST_CASE("a triple buffer shows the newest of several values") {
    TripleBuffer<int> buffer(0);
    for (int round = 1; round < 50; round++) {
        for (int i = 0; i < round % 5 + 1; i++) {
            buffer.write_slot() = 100 * round + i;
            buffer.publish();
        }
        CHECK(buffer.latest() == 100 * round + round % 5);
    }
}

TEST_CASE("the value that the reader holds is never written") {
    TripleBuffer<int> buffer(0);
    for (int round = 1; round < 20; round++) {
        buffer.write_slot() = round;
        buffer.publish();
        const int& held = buffer.latest();
        for (int i = 0; i < 7; i++) {
            CHECK(&buffer.write_slot() != &held);
            buffer.write_slot() = -1;
            buffer.publish();
            CHECK(held == round);
        }
        buffer.latest();
    }
}

// Every value is a row of equal numbers: a row of different ones was read while it was written.
TEST_CASE("two threads: no torn value, never an older one, the last one arrives") {
    constexpr int count = 100000;
    using Row = std::array<int, 40>;
    TripleBuffer<Row> buffer{Row{}};
    std::atomic<bool> done{false};
    std::thread writer([&] {
        for (int i = 1; i <= count; i++) {
            buffer.write_slot().fill(i);
            buffer.publish();
        }
        done = true;
    });
    int torn = 0, older = 0, last = 0;
    for (bool more = true; more;) {
        more = !done;
        const Row& row = buffer.latest();
        const int first = row[0];
        for (int value : row) torn += value != first;
        older += first < last;
        last = first;
    }
    writer.join();
    CHECK(torn == 0);
    CHECK(older == 0);
    CHECK(last == count);
}
