#include "interpolate.h"
#include "dispatch.h"
#include "parallel.h"
#include <algorithm>
#include <vector>

namespace palpate {
namespace {

// Two slices' two rows each become one.
PALPATE_KERNEL void mix_rows(const float* const rows[4], float y, float z, int64_t count, float* out) {
    const float *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3];
    for (int64_t x = 0; x < count; x++) {
        const float low = a[x] + y * (b[x] - a[x]), high = c[x] + y * (d[x] - c[x]);
        out[x] = low + z * (high - low);
    }
}

PALPATE_KERNEL void spread_row(const float* row, const Positions& x, float weight, float* out) {
    const int32_t* at = x.at;
    const float *share = x.share, *kept = x.weight;
    for (int64_t i = 0; i < x.count; i++) {
        const float low = row[at[i]], high = row[at[i] + 1];
        out[i] = (low + share[i] * (high - low)) * (kept[i] * weight);
    }
}

} // namespace

void interpolate(const float* values, const Positions& z, const Positions& y, const Positions& x, float* out) {
    parallel(z.count * y.count, [&](int64_t begin, int64_t end, int) {
        std::vector<float> row(x.old + 1); // the last is read where there is but one
        for (int64_t index = begin; index < end; index++) {
            const int64_t k = index / y.count, j = index % y.count;
            const auto at = [&](int64_t above, int64_t beside) {
                const int64_t slice = std::min<int64_t>(z.at[k] + above, z.old - 1);
                return values + (slice * y.old + std::min<int64_t>(y.at[j] + beside, y.old - 1)) * x.old;
            };
            const float* rows[4] = {at(0, 0), at(0, 1), at(1, 0), at(1, 1)};
            mix_rows(rows, y.share[j], z.share[k], x.old, row.data());
            row[x.old] = row[x.old - 1];
            spread_row(row.data(), x, y.weight[j] * z.weight[k], out + index * x.count);
        }
    });
}

} // namespace palpate
