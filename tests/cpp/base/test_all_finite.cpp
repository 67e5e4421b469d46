#include "base/all_finite.h"
#include <cmath>
#include <doctest.h>
#include <limits>
#include <vector>

TEST_CASE("one infinite or undefined value anywhere is found, the largest finite one is not") {
    using limit = std::numeric_limits<float>;
    std::vector<float> values(200000, limit::max());
    CHECK(palpate::all_finite(values.data(), int64_t(values.size())));
    for (size_t at : {size_t(0), size_t(7), size_t(65535), size_t(65536), values.size() - 1})
        for (float bad : {limit::infinity(), -limit::infinity(), limit::quiet_NaN()}) {
            values[at] = bad;
            CHECK_FALSE(palpate::all_finite(values.data(), int64_t(values.size())));
            values[at] = -limit::max();
        }
    CHECK(palpate::all_finite(values.data(), int64_t(values.size())));
    CHECK(palpate::all_finite(values.data(), 0));
}
