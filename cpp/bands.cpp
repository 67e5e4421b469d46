#include "bands.h"
#include "band_kernels.h"
#include <algorithm>

namespace palpate {
namespace {

// How far each eight neighbours reach from the first of them; far too far where one begins before it.
int reach_of_eight(const std::vector<int32_t>& first) {
    int most = 0;
    for (size_t i = 0; i < first.size(); i++) {
        const int step = first[i] - first[i / lanes * lanes];
        most = std::max(most, step < 0 ? 2 * lanes : step);
    }
    return most;
}

Span span_of(int reach) { return reach < lanes ? Span::near : reach < 2 * lanes ? Span::wide : Span::any; }

int round_up(int n, int step) { return (n + step - 1) / step * step; }

} // namespace

void Bands::make(const Geometry& geometry, const View& view, int z, Axis axis, int of_image) {
    terms = palpate::products(view);
    columns = of_image;
    parts.resize(terms);
    for (int s = 0; s < terms; s++) by_voxel(geometry, view, z, s, axis, parts[s]);
    taps = std::max(2, extents(parts, low, count));
    place();
    if (walked()) return list();
    lay_out();
    couple();
    turn();
}

// Where each voxel begins, and how far its columns reach among its neighbours.
void Bands::place() {
    const int n = int(low.size());
    first.assign(round_up(n, lanes), 0);
    std::copy(low.begin(), low.end(), first.begin());
    // Voxels that the panel's edge cuts all begin in column 0; that they go on beyond it keeps them rising. Those that
    // touch nothing begin where their neighbours do.
    for (int i = n - 2; i >= 0; i--)
        if (count[i] == 0)
            first[i] = first[i + 1];
        else if (low[i] == 0 && count[i + 1] > 0 && first[i + 1] <= 0 && first[i + 1] > -lanes)
            first[i] = first[i + 1] - 1, taps = std::max(taps, count[i] - first[i]);
    for (int i = 1; i < int(first.size()); i++)
        if (i >= n || count[i] == 0) first[i] = std::max(first[i], first[i - 1]);
    seen_begin = int(std::find_if(count.begin(), count.end(), [](int32_t c) { return c > 0; }) - count.begin());
    seen_end = n;
    while (seen_end > seen_begin && count[seen_end - 1] == 0) seen_end--;
    ahead = 0;
    bool rising = true; // each voxel begins a column or more behind the one before
    for (int i = 0; i < n; i++) {
        if (count[i] == 0) continue;
        rising = rising && (i == 0 || count[i - 1] == 0 || first[i] > first[i - 1]);
        while (i + ahead + 1 < n && count[i + ahead + 1] > 0 && low[i + ahead + 1] < low[i] + count[i]) ahead++;
    }
    kernel = rising && terms <= most_terms && taps <= most_taps ? 10 * terms + taps : 0;
    const int reach = reach_of_eight(first);
    close = reach + taps <= 2 * lanes;
}

// Per voxel and column under it the weight in each term.
void Bands::list() {
    const size_t each = size_t(taps) * terms;
    weight.assign(low.size() * each, 0.0f);
    for (int m = 0; m < terms; m++)
        for (size_t i = 0; i < low.size(); i++)
            for (int t = 0; t < count[i]; t++) {
                const int tap = low[i] + t - parts[m].first[i];
                if (tap >= 0 && tap < parts[m].taps)
                    weight[i * each + size_t(t) * terms + m] = parts[m].weight[size_t(tap) * low.size() + i];
            }
}

// Per voxel and term `taps` zeros, then the weights from column first on: what another voxel's columns read beyond is
// 0. Voxels of 0s follow the last.
void Bands::lay_out() {
    const int n = int(low.size());
    dense.assign((first.size() + taps) * terms * 2 * taps, 0.0f);
    for (int m = 0; m < terms; m++)
        for (int i = 0; i < n; i++) {
            if (count[i] == 0) continue;
            float* out = &dense[(size_t(i) * terms + m) * 2 * taps + taps];
            for (int t = low[i]; t < low[i] + count[i]; t++) {
                const int tap = t - parts[m].first[i];
                if (tap >= 0 && tap < parts[m].taps) out[t - first[i]] = parts[m].weight[size_t(tap) * n + i];
            }
        }
}

// Eight voxels a vector; in the order that `look` reads: terms, taps; pairs of terms, taps, voxels ahead.
template <int terms, int taps> void Bands::couple_by() {
    constexpr int size = terms * taps + pairs_of(terms) * taps * (taps + 1) / 2;
    weight.resize(first.size() * size);
    for (size_t i = 0; i < first.size(); i++) {
        float* out = &weight[i / lanes * lanes * size + i % lanes];
        const float* w[taps][terms];
        for (int k = 0; k < taps; k++)
            for (int m = 0; m < terms; m++)
                w[k][m] = at(int(i) + k, m, i + k < first.size() ? first[i + k] - first[i] : taps);
        for (int m = 0; m < terms; m++)
            for (int t = 0; t < taps; t++, out += lanes) *out = w[0][m][t];
        for (int m = 0; m < terms; m++)
            for (int s = m; s < terms; s++)
                for (int t = 0; t < taps; t++)
                    for (int k = 0; k <= t; k++, out += lanes)
                        *out = m == s ? w[0][m][t] * w[k][m][t] : w[0][m][t] * w[k][s][t] + w[0][s][t] * w[k][m][t];
    }
}

void Bands::couple() {
    switch (kernel) {
    case 12:
        return couple_by<1, 2>();
    case 13:
        return couple_by<1, 3>();
    case 14:
        return couple_by<1, 4>();
    case 15:
        return couple_by<1, 5>();
    case 16:
        return couple_by<1, 6>();
    case 22:
        return couple_by<2, 2>();
    case 23:
        return couple_by<2, 3>();
    case 24:
        return couple_by<2, 4>();
    case 25:
        return couple_by<2, 5>();
    case 26:
        return couple_by<2, 6>();
    }
}

// The same weights by column: the voxels over each.
void Bands::turn() {
    const int n = int(low.size()), size = round_up(columns, 2 * lanes) + 2 * lanes;
    std::vector<int32_t> last(size, -1);
    first_voxel.assign(size, INT32_MAX);
    for (int i = 0; i < n; i++)
        for (int c = low[i]; c < low[i] + count[i]; c++) {
            first_voxel[c] = std::min(first_voxel[c], i);
            last[c] = i;
        }
    spread_taps = 1;
    for (int c = 0, before = 0; c < size; c++) {
        if (last[c] >= 0) spread_taps = std::max(spread_taps, last[c] - first_voxel[c] + 1);
        before = first_voxel[c] = last[c] >= 0 ? first_voxel[c] : before;
    }
    const int reach = reach_of_eight(first_voxel);
    around = 4 * reach + spread_taps + 2 * lanes;
    spread_span = span_of(reach);
    spread_weight.assign(size_t(size) * terms * spread_taps, 0.0f);
    for (int i = 0; i < n; i++)
        for (int c = low[i]; c < low[i] + count[i]; c++) {
            const int tap = (i - first_voxel[c]) * terms; // in the order that `spread` reads: taps, terms
            float* out = &spread_weight[size_t(c / lanes) * lanes * terms * spread_taps + c % lanes];
            for (int m = 0; m < terms; m++) out[(tap + m) * lanes] = at(i, m, 0)[c - first[i]];
        }
}

void Bands::look(Looked rows, int from, int begin, int end) const {
    const int groups = (end - begin + lanes - 1) / lanes;
    rows.sums -= from;
    look_at(kernel, close, weight.data() + begin * (weight.size() / first.size()), first.data() + begin, groups, rows);
}

void Bands::spread(const float* change, int begin, int from, int n, float* out, int64_t pitch) const {
    spread_at(spread_span, spread_weight.data() + int64_t(from) * terms * spread_taps, first_voxel.data() + from, terms,
              spread_taps, change - begin, n, out, pitch);
}

} // namespace palpate
