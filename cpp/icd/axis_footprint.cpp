#include "icd/axis_footprint.h"
#include <algorithm>

namespace palpate {

void AxisFootprint::make(const ScanGeometry& geometry, const View& view, int z, Axis axis) {
    terms = products(view);
    parts.resize(terms);
    for (int s = 0; s < terms; s++) voxel_weights(geometry, view, z, s, axis, parts[s]);
    width = std::max(1, find_extents());
    set_weights();
}

// Returns the largest count.
int AxisFootprint::find_extents() {
    const int n = parts[0].n;
    first.assign(n, INT32_MAX);
    count.assign(n, 0); // for now the end
    for (const AxisWeights& part : parts)
        for (int t = 0; t < part.taps; t++)
            for (int i = 0; i < n; i++)
                if (part.weight[size_t(t) * n + i] != 0) {
                    first[i] = std::min(first[i], part.first[i] + t);
                    count[i] = std::max(count[i], part.first[i] + t + 1);
                }
    int most = 0;
    for (int i = 0; i < n; i++) {
        count[i] = count[i] ? count[i] - first[i] : first[i] = 0;
        most = std::max(most, int(count[i]));
    }
    return most;
}

int AxisFootprint::independent_step(int extra_pixels) const {
    const int n = int(first.size());
    int step = 1;
    for (int i = 0; i < n; i++) {
        if (count[i] == 0) continue;
        const int end = first[i] + count[i] + extra_pixels;
        while (i + step < n && count[i + step] > 0 && first[i + step] < end) step++;
    }
    return step;
}

void AxisFootprint::set_weights() {
    const size_t n = first.size(), size = stride();
    weight.assign(n * width * size, 0);
    for (int s = 0; s < terms; s++)
        for (int t = 0; t < parts[s].taps; t++)
            for (size_t i = 0; i < n; i++)
                if (float w = parts[s].weight[size_t(t) * n + i])
                    weight[(i * width + parts[s].first[i] + t - first[i]) * size + s] = w;
    for (size_t i = 0; i < n * width; i++) {
        float *w = &weight[i * size], *product = w + terms;
        for (int m = 0; m < terms; m++)
            for (int k = m; k < terms; k++) *product++ = w[m] * w[k];
    }
}

} // namespace palpate
