#include "icd/surrogate_images.h"
#include "base/cpu_dispatch.h"
#include "base/thread_pool.h"
#include "icd/view_layout.h"
#include <algorithm>

namespace palpate {
namespace {

// out = image · length^power for pixels `step` apart; length: of the rays' paths.
PALPATE_KERNEL void scale(const float* __restrict image, const float* __restrict length, int power, int count,
                          int64_t step, float* __restrict out) {
    for (int i = 0; i < count; i++) out[i] = image[i * step] * (power == 2 ? length[i] * length[i] : length[i]);
}

} // namespace

SurrogateImages::SurrogateImages(const ScanGeometry& g) : geometry(g) {
    int64_t size = 0;
    for (const View& v : geometry.views)
        for (int i = 0; i < 2; i++) {
            start.push_back(size);
            const ViewLayout layout(v);
            size += layout.rows * layout.stride + column_padding;
        }
    images = HugePageBuffer(size);
    std::fill_n(images.data(), size, 0.0f);
}

void SurrogateImages::set(const float* image, int which) {
    constexpr int part = 32; // rows of a task
    int most = 0;
    for (const View& v : geometry.views) most = std::max(most, (ViewLayout(v).rows + part - 1) / part);
    parallel_tasks(most * int64_t(geometry.views.size()), [&](int64_t task, int) {
        const int k = int(task / most), first = int(task % most) * part;
        const View& v = geometry.views[k];
        const ViewLayout layout(v);
        const float* from = image + k * geometry.pixels();
        std::vector<float> length(layout.columns);
        for (int row = first; row < std::min(layout.rows, first + part); row++) {
            const int64_t pixel = layout.start + row * layout.down;
            float* out = images.data() + start[2 * k + which] + row * layout.stride;
            if (layout.separable) {
                v.path(pixel, layout.right, layout.columns, length.data());
                scale(from + pixel, length.data(), 1 + which, layout.columns, layout.right, out);
            } else {
                std::copy_n(from + pixel, layout.columns, out);
            }
        }
    });
}

} // namespace palpate
