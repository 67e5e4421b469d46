#include "linalg/sparse_cholesky.h"
#include "base/thread_pool.h"
#include "linalg/frontal_matrix.h"
#include "linalg/triangular_solve.h"
#include <algorithm>
#include <atomic>
#include <cfloat>
#include <memory>

namespace palpate {
namespace {

constexpr int width = Supernodes::panel, tile = width * width;
constexpr int leaf = 12; // nodes that need no further cut

struct Workspace { // of a thread
    std::vector<double> front;
    std::vector<int> local;       // where the unknowns of a place are in the front
    std::vector<int64_t> address; // of a child's row in the front
};

class Factoring {
public:
    Factoring(const BlockCsr& K, const Supernodes& tree, FactorValues<double>& value)
        : K(K), tree(tree), value(value), children(tree.count()), update(tree.count()) {
        for (int s = 0; s < tree.count(); s++)
            if (tree.parent[s] >= 0) children[tree.parent[s]].push_back(s);
    }

    bool run() {
        std::vector<Workspace> workspaces(threads());
        for (auto& w : workspaces) w.local.resize(tree.nodes());
        std::vector<int> roots = subtrees();
        parallel_tasks(int64_t(roots.size()),
                       [&](int64_t task, int thread) { climb(roots[task], workspaces[thread]); });
        for (int s = 0; s < tree.count(); s++)
            if (above[s]) eliminate_supernode(s, workspaces[0]);
        return !failed;
    }

private:
    const BlockCsr& K;
    const Supernodes& tree;
    FactorValues<double>& value;
    std::vector<std::vector<int>> children;
    std::vector<std::unique_ptr<double[]>> update; // Schur complements that wait for the parent, as panels
    std::vector<uint8_t> above;                    // supernodes above all the subtrees that are tasks
    std::atomic<bool> failed{false};

    // Roots of independent subtrees of at most a sixteenth of the work, the longest first.
    std::vector<int> subtrees() {
        std::vector<double> work(tree.count());
        double whole = 0;
        for (int s = 0; s < tree.count(); s++) {
            whole += tree.work(s);
            work[s] += tree.work(s);
            if (tree.parent[s] >= 0) work[tree.parent[s]] += work[s];
        }
        above.assign(tree.count(), 0);
        std::vector<int> roots;
        for (int s = tree.count() - 1; s >= 0; s--) {
            const bool top = tree.parent[s] < 0 || above[tree.parent[s]];
            if (top && work[s] > whole / 16)
                above[s] = 1;
            else if (top)
                roots.push_back(s);
        }
        std::vector<std::pair<double, int>> order;
        for (int s : roots) order.emplace_back(-work[s], -s);
        std::sort(order.begin(), order.end());
        for (size_t k = 0; k < roots.size(); k++) roots[k] = -order[k].second;
        return roots;
    }

    void climb(int root, Workspace& w) {
        for (int child : children[root]) climb(child, w);
        eliminate_supernode(root, w);
    }

    void eliminate_supernode(int s, Workspace& w) {
        if (failed) return;
        const int own = tree.own_panels(s), below = tree.below_panels(s);
        w.front.resize(std::max<size_t>(w.front.size(), FrontalMatrix::size(own + below)));
        const FrontalMatrix front{w.front.data(), own + below};
        std::fill_n(front.data, FrontalMatrix::size(own + below), 0.0);
        assemble(s, front, w);
        for (int child : children[s]) {
            add(child, front, w);
            update[child].reset();
        }
        double* out = value.data() + tree.entry_start[s];
        // The inverses of the diagonal tiles wait where the last panels will be written.
        std::vector<double> inverse(size_t(own) * tile);
        if (!eliminate(front, own, inverse.data())) {
            failed = true;
            return;
        }
        for (int p = 0; p < own; p++) {
            out = std::copy_n(front.at(p), int64_t(tile) * p, out);
            out = std::copy_n(inverse.data() + int64_t(tile) * p, tile, out);
        }
        for (int p = own; p < own + below; p++) out = std::copy_n(front.at(p), int64_t(tile) * own, out);
        if (below == 0) return;
        update[s].reset(new double[FrontalMatrix::size(below)]);
        for (int p = 0; p < below; p++)
            std::copy_n(front.at(own + p) + int64_t(tile) * own, int64_t(tile) * (p + 1),
                        update[s].get() + FrontalMatrix::offset(p));
    }

    // The supernode's own columns of K; unit pivots where columns are padded.
    void assemble(int s, const FrontalMatrix& front, Workspace& w) const {
        const int begin = tree.first[s], end = tree.first[s + 1], pad = width * tree.own_panels(s);
        for (int at = begin; at < end; at++) w.local[at] = 3 * (at - begin);
        for (int64_t k = tree.row_start[s]; k < tree.row_start[s + 1]; k++)
            w.local[tree.row[k]] = pad + 3 * int(k - tree.row_start[s]);
        for (int at = begin; at < end; at++) {
            const int node = tree.order[at], j = w.local[at];
            for (int k = K.start[node]; k < K.start[node + 1]; k++) {
                const int other = tree.place[K.column[k]];
                if (other < at) continue;
                const int i = w.local[other];
                const double* block = &K.block[9 * size_t(k)];
                for (int c = 0; c < 3; c++)
                    for (int r = 0; r < 3; r++)
                        if (i + r >= j + c)
                            front.at((i + r) / width)[width * (j + c) + (i + r) % width] += block[3 * c + r];
            }
        }
        for (int j = 3 * (end - begin); j < pad; j++) front.at(j / width)[width * j + j % width] = 1;
    }

    // Extends a child's Schur complement and adds it.
    void add(int child, const FrontalMatrix& front, Workspace& w) const {
        const int rows = tree.below(child);
        w.address.resize(std::max<size_t>(w.address.size(), 2 * size_t(rows)));
        int64_t *row = w.address.data(), *column = row + rows;
        for (int k = 0; k < rows; k++) {
            const int i = w.local[tree.row[tree.row_start[child] + k / 3]] + k % 3;
            row[k] = FrontalMatrix::offset(i / width) + i % width;
            column[k] = width * int64_t(i);
        }
        const double* from = update[child].get();
        for (int p = 0; width * p < rows; p++) {
            const double* panel = from + FrontalMatrix::offset(p);
            const int many = std::min(width, rows - width * p);
            for (int j = 0; j < width * p + many; j++)
                for (int i = std::max(0, j - width * p); i < many; i++)
                    front.data[row[width * p + i] + column[j]] += panel[width * j + i];
        }
    }
};

} // namespace

SparseCholesky::SparseCholesky(const BlockCsr& K, const double* places) : tree(K, dissect(K, places, leaf)) {
    double trace = 0;
    for (int i = 0; i < K.nodes(); i++)
        for (int k = K.start[i]; k < K.start[i + 1]; k++)
            if (K.column[k] == i)
                for (int c = 0; c < 3; c++) trace += K.block[9 * size_t(k) + 4 * c];
    const double rounding = (3.0 * K.nodes() + 4) * (DBL_EPSILON / 2);
    slack = rounding / (1 - 2 * rounding) * trace;
    value.resize(tree.entry_start.back());
    positive = Factoring(K, tree, value).run();
    if (!positive) value = {};
}

FactorValues<float> SparseCholesky::rounded() const { return {value.begin(), value.end()}; }

void SparseCholesky::solve(double* x, int columns) const {
    const int n = 3 * tree.nodes();
    std::vector<int> all(tree.count());
    for (int s = 0; s < tree.count(); s++) all[s] = s;
    if (columns == 1) {
        TriangularSolve<double> work(tree, 1);
        for (int i = 0; i < n; i++) work.x[3 * tree.place[i / 3] + i % 3] = x[i];
        work.forward(value.data(), all.data(), tree.count());
        work.backward(value.data(), all.data(), tree.count());
        for (int i = 0; i < n; i++) x[i] = work.x[3 * tree.place[i / 3] + i % 3];
        return;
    }
    constexpr int most = 4; // groups of columns at a time: what is read of the factor serves 32
    const int groups = (columns + width - 1) / width, tasks = (groups + most - 1) / most;
    std::vector<std::unique_ptr<TriangularSolve<double>>> works(threads());
    parallel_tasks(tasks, [&](int64_t task, int thread) {
        const int first = int(task) * most, many = std::min(most, groups - first);
        if (!works[thread]) works[thread] = std::make_unique<TriangularSolve<double>>(tree, most * width);
        auto& work = *works[thread];
        work.groups = many;
        for (int i = 0; i < n; i++)
            for (int c = 0; c < width * many; c++) {
                const int column = width * first + c;
                work.of(c / width, 3 * tree.place[i / 3] + i % 3)[c % width] =
                    column < columns ? x[size_t(i) * columns + column] : 0;
            }
        work.forward(value.data(), all.data(), tree.count());
        work.backward(value.data(), all.data(), tree.count());
        for (int i = 0; i < n; i++)
            for (int c = 0; c < width * many && width * first + c < columns; c++)
                x[size_t(i) * columns + width * first + c] =
                    work.of(c / width, 3 * tree.place[i / 3] + i % 3)[c % width];
    });
}

} // namespace palpate
