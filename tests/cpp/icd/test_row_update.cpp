// The update of a row group against coordinate descent in scalar float64, one row after the other.
#include "icd/row_update.h"
#include <algorithm>
#include <cmath>
#include <doctest.h>
#include <random>

using namespace palpate;

namespace {

constexpr int begin = 3, count = 20, nx = 40, rows = 5;
constexpr double edge = 0.02;

std::mt19937 random_bits(7);
double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_bits); }

// Footprints along x of random weights: voxel i touches columns i to i + 2, from the first that there is on.
AxisFootprint footprint(int terms, int first_seen) {
    AxisFootprint out;
    out.terms = terms;
    out.width = 3;
    out.first.assign(nx, 0);
    out.count.assign(nx, 0);
    out.weight.assign(size_t(nx) * out.width * out.stride(), 0.0f);
    for (int x = first_seen; x < nx; x++) {
        out.first[x] = x - first_seen;
        out.count[x] = 3;
        for (int t = 0; t < 3; t++) {
            float* w = &out.weight[(size_t(x) * 3 + t) * out.stride()];
            for (int m = 0; m < terms; m++) w[m] = float(uniform(-0.5, 1));
            int pair = terms;
            for (int m = 0; m < terms; m++)
                for (int k = m; k < terms; k++) w[pair++] = w[m] * w[k];
        }
    }
    return out;
}

// A view of the row group: what each column holds, and the same in float64 for one row.
struct View1D {
    AxisFootprint along_x;
    std::vector<double> S, C; // (columns, terms, lanes), (columns, terms, terms, lanes): C = B B' over random B

    View1D(int terms, int first_seen) : along_x(footprint(terms, first_seen)) {}
    int terms() const { return along_x.terms; }
    double& slope(int column, int m, int lane) { return S[(size_t(column) * terms() + m) * lanes + lane]; }
    double& curvature(int column, int m, int k, int lane) {
        return C[((size_t(column) * terms() + m) * terms() + k) * lanes + lane];
    }

    void fill(ColumnSums& out) {
        out.start(along_x, begin, begin + count);
        S.resize(size_t(nx + 8) * terms() * lanes);
        C.resize(S.size() * terms());
        for (int a = 0; a < out.n; a++)
            for (int lane = 0; lane < lanes; lane++) {
                double B[3][3];
                for (auto& row : B)
                    for (double& v : row) v = uniform(-1, 1);
                float* sums = &out.sums[size_t(a) * along_x.stride() * lanes + lane];
                for (int m = 0; m < terms(); m++)
                    sums[m * lanes] = float(slope(out.from + a, m, lane) = uniform(-0.2, 0.1));
                int pair = terms();
                for (int m = 0; m < terms(); m++)
                    for (int k = m; k < terms(); k++, pair++) {
                        double sum = 0;
                        for (int i = 0; i < 3; i++) sum += B[m][i] * B[k][i];
                        sums[pair * lanes] = float(sum);
                        curvature(out.from + a, m, k, lane) = curvature(out.from + a, k, m, lane) = sum;
                    }
            }
    }
    // Slope and curvature of a voxel, and the columns after its change.
    void derivatives(int x, int lane, double& first, double& second) {
        for (int t = 0; t < along_x.count[x]; t++)
            for (int m = 0; m < terms(); m++) {
                const float* w = &along_x.weight[(size_t(x) * 3 + t) * along_x.stride()];
                const int column = along_x.first[x] + t;
                first += w[m] * slope(column, m, lane);
                for (int k = 0; k < terms(); k++) second += double(w[m]) * w[k] * curvature(column, m, k, lane);
            }
    }
    void change(int x, int lane, double by) {
        for (int t = 0; t < along_x.count[x]; t++)
            for (int m = 0; m < terms(); m++)
                for (int k = 0; k < terms(); k++) {
                    const float* w = &along_x.weight[(size_t(x) * 3 + t) * along_x.stride()];
                    slope(along_x.first[x] + t, m, lane) += curvature(along_x.first[x] + t, m, k, lane) * w[k] * by;
                }
    }
};

// ψ'(t)/t
double potential_weight(Potential potential, double t) {
    const double s = std::abs(t) / edge;
    switch (potential) {
    case Potential::lange:
        return 1 / (1 + s);
    case Potential::huber:
        return s < 1 ? 1 : 1 / s;
    default:
        return 1;
    }
}

void check(Potential potential, double beta, double relaxation, bool backwards, std::vector<View1D> views) {
    const int64_t shape[3] = {1, 1, nx};
    const double spacing[3] = {2, 1.5, 0.75};
    const double pair_weight = 2 * 1.5 * 0.75 / (0.75 * 0.75); // volume over (distance times least spacing)
    PotentialParameters law;
    law.potential = potential;
    law.edge = float(edge);
    const Neighbourhood neighbours = neighbourhood(shape, spacing, law, 26);
    const ScanGeometry nothing({1, 1, nx, 2, 1.5, 0.75, 0, 0, 10}, 0, 1, 1, nullptr, nullptr, nullptr, nullptr, nullptr,
                               1e-3);
    SurrogateImages images(nothing);
    const SparseFootprints footprints(nothing);
    RowGroup group;
    group.rows = rows;
    GroupPart part;
    part.begin = begin;
    part.columns.resize(views.size());
    for (size_t k = 0; k < views.size(); k++) views[k].fill(part.columns[k]);
    for (int i = 0; i < (count + 2) * lanes; i++) part.f.push_back(float(std::max(0.0, uniform(-0.02, 0.06))));
    for (int i = 0; i < count * lanes; i++) {
        part.prior_slope.push_back(float(uniform(-0.1, 0.1)));
        part.prior_curvature.push_back(float(uniform(0.5, 2)));
    }
    const AlignedBuffer before = part.f;
    RowUpdate{neighbours, float(beta), float(relaxation), footprints}.update(part, count, backwards, group, images);
    for (int lane = 0; lane < rows; lane++) {
        std::vector<double> f;
        for (int i = 0; i < count + 2; i++) f.push_back(before[i * lanes + lane]);
        for (int j = 0; j < count; j++) {
            const int i = backwards ? count - 1 - j : j, x = begin + i;
            double first = beta * part.prior_slope[i * lanes + lane],
                   second = beta * part.prior_curvature[i * lanes + lane];
            for (View1D& view : views) view.derivatives(x, lane, first, second);
            const double t = f[i + 1] - f[backwards ? i + 2 : i],
                         pair = beta * pair_weight * potential_weight(potential, t);
            const double old = f[i + 1];
            if (second + pair > 0) f[i + 1] = std::max(0.0, old - relaxation * (first + pair * t) / (second + pair));
            for (View1D& view : views) view.change(x, lane, f[i + 1] - old);
        }
        for (int i = 0; i < count + 2; i++)
            CHECK(std::abs(part.f[i * lanes + lane] - f[i]) < 2e-5); // values are about 0.1
    }
}

} // namespace

TEST_CASE("a row update is sequential coordinate descent") {
    for (const bool backwards : {false, true}) {
        CAPTURE(backwards);
        check(Potential::lange, 0.3, 1.0, backwards, {{1, 0}, {1, 2}});
        check(Potential::lange, 0.3, 1.6, backwards, {{2, 0}, {1, 1}});
        check(Potential::huber, 0.5, 1.0, backwards, {{3, 0}, {2, 1}});
        check(Potential::quadratic, 0.2, 1.2, backwards, {{1, 8}}); // voxels before 8 touch no pixel
    }
}

TEST_CASE("a voxel that no ray and no neighbour determines stays as it is") {
    check(Potential::lange, 0, 1, false, {});
}
