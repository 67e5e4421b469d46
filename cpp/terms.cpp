#include "terms.h"
#include <algorithm>

namespace palpate {

Layout::Layout(const View& view) {
    separable = view.pose == Pose::parallel || (view.pose == Pose::turned && !view.swapped);
    if (separable) {
        rows = view.swapped ? view.na : view.nb;
        columns = view.swapped ? view.nb : view.na;
        start = view.start;
        down = view.swapped ? view.step_a : view.step_b;
        right = view.swapped ? view.step_b : view.step_a;
        stride = columns + column_padding;
    } else {
        rows = view.panel.rows;
        columns = view.panel.columns;
        start = 0;
        down = stride = columns;
        right = 1;
    }
}

int extents(const std::vector<AxisWeights>& terms, std::vector<int32_t>& first, std::vector<int32_t>& count) {
    const int n = terms[0].n;
    first.assign(n, INT32_MAX);
    count.assign(n, 0); // for now the end
    for (const AxisWeights& part : terms)
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

void AxisTerms::make(const Geometry& geometry, const View& view, int z, Axis axis) {
    terms = products(view);
    parts.resize(terms);
    for (int s = 0; s < terms; s++) by_voxel(geometry, view, z, s, axis, parts[s]);
    width = std::max(1, extents(parts, first, count));
    lay_out();
}

int AxisTerms::apart(int spread) const {
    const int n = int(first.size());
    int apart = 1;
    for (int i = 0; i < n; i++) {
        if (count[i] == 0) continue;
        const int end = first[i] + count[i] + spread - 1;
        while (i + apart < n && count[i + apart] > 0 && first[i + apart] < end) apart++;
    }
    return apart;
}

// The weights laid out per voxel and pixel, and their products.
void AxisTerms::lay_out() {
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
