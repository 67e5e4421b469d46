#include "volume/trilinear_resample.h"
#include "base/cpu_dispatch.h"
#include "base/thread_pool.h"
#include <algorithm>
#include <vector>

namespace palpate {
namespace {

// Interpolates between two rows of each of two slices.
PALPATE_KERNEL void interpolate_rows(const float* const rows[4], float y, float z, int64_t count, float* out) {
    const float *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3];
    for (int64_t x = 0; x < count; x++) {
        const float low = a[x] + y * (b[x] - a[x]), high = c[x] + y * (d[x] - c[x]);
        out[x] = low + z * (high - low);
    }
}

PALPATE_KERNEL void interpolate_along_row(const float* row, const InterpolationPoints& x, float weight, float* out) {
    const int32_t* at = x.at;
    const float *share = x.share, *inside = x.weight;
    for (int64_t i = 0; i < x.count; i++) {
        const float low = row[at[i]], high = row[at[i] + 1];
        out[i] = (low + share[i] * (high - low)) * (inside[i] * weight);
    }
}

} // namespace

void interpolate(const float* values, const InterpolationPoints& z, const InterpolationPoints& y,
                 const InterpolationPoints& x, float* out) {
    parallel(z.count * y.count, [&](int64_t begin, int64_t end, int) {
        std::vector<float> row(x.old + 1); // one more: its last value twice
        for (int64_t index = begin; index < end; index++) {
            const int64_t k = index / y.count, j = index % y.count;
            const auto at = [&](int64_t dz, int64_t dy) {
                const int64_t slice = std::min<int64_t>(z.at[k] + dz, z.old - 1);
                return values + (slice * y.old + std::min<int64_t>(y.at[j] + dy, y.old - 1)) * x.old;
            };
            const float* rows[4] = {at(0, 0), at(0, 1), at(1, 0), at(1, 1)};
            interpolate_rows(rows, y.share[j], z.share[k], x.old, row.data());
            row[x.old] = row[x.old - 1];
            interpolate_along_row(row.data(), x, y.weight[j] * z.weight[k], out + index * x.count);
        }
    });
}

} // namespace palpate
