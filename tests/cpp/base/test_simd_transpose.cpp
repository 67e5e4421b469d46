#include "base/simd_transpose.h"
#include <doctest.h>
#include <vector>

TEST_CASE("rows go to lanes and back, for any length and number of rows") {
    constexpr int lanes = 8;
    for (int count : {1, 3, 8})
        for (int64_t n : {1, 7, 8, 29})
            for (int step : {1, 3}) {
                std::vector<std::vector<float>> rows(count, std::vector<float>(n)), back = rows;
                std::vector<const float*> from;
                std::vector<float*> to;
                for (int i = 0; i < count; i++) {
                    for (int64_t x = 0; x < n; x++) rows[i][x] = float(1 + 100 * i + x);
                    from.push_back(rows[i].data());
                    to.push_back(back[i].data());
                }
                std::vector<float> out(n * step * lanes, -1);
                palpate::into_lanes(from.data(), count, n, out.data(), step);
                for (int64_t x = 0; x < n; x++)
                    for (int i = 0; i < lanes; i++)
                        CHECK(out[x * step * lanes + i] == (i < count ? float(1 + 100 * i + x) : 0));
                palpate::out_of_lanes(out.data(), count, n, to.data(), step);
                CHECK(back == rows);
            }
}
