#include "realtime/latency_histogram.h"
#include <doctest.h>
#include <numeric>

TEST_CASE("a latency is counted in its step of 10 us, the longest ones in the last") {
    using std::chrono::microseconds;
    palpate::LatencyHistogram histogram;
    for (int us : {0, 9, 10, 19, 25, 10000, 5000000}) histogram.add(microseconds(us));
    histogram.add(microseconds(-3));
    const std::vector<int64_t> counts = histogram.counts();
    CHECK(counts[0] == 3);
    CHECK(counts[1] == 2);
    CHECK(counts[2] == 1);
    CHECK(counts.back() == 2);
    CHECK(std::accumulate(counts.begin(), counts.end(), int64_t(0)) == 8);
}
