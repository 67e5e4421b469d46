#pragma once
#include "partial.h"
#include <atomic>
#include <memory>

namespace palpate {

// What Green's functions need of a tissue, once and for all.
struct Elastic {
    const Cholesky* factor;       // of the stiffness among the free nodes
    FactorValues<float> single;   // the same, rounded: columns err by 1e-5 of themselves or less
    std::vector<int> free;        // (nodes) a node's number among the free ones, or -1 where it is held
    std::vector<int> vertex;      // (nodes) a node's number among the vertices, or -1
    std::vector<int> node, place; // (vertices) free nodes that are touched or shown: their node, and their free number
    std::vector<double> position; // (vertices, 3) mm, at rest
    int vertices() const { return int(node.size()); }
    int nodes() const { return int(free.size()); }
    double apart(int a, int b) const; // mm
};

// The compliance between vertices: blocks G_ij (3x3, mm/N, of K^-1) among those near each other, for forces, and whole
// columns over all vertices, for displays. Made as they are needed, by one thread at a time; the least recently used
// ones go when they take more than a budget, never one that was named in use. Blocks may be read by one other thread
// while they are made: no lock, no wait.
class Green {
public:
    Green(const Elastic& elastic, size_t budget); // bytes
    ~Green();

    static constexpr int batch = 8; // nodes that are solved for together: 24 columns

    // --- the thread that makes them
    // Blocks of these vertices (at most `batch`) with all others within `reach` mm.
    void make_near(const int* vertices, int count, double reach);
    void make_columns(const int* vertices, int count);
    bool near_made(int vertex, double reach) const { return reached[vertex] >= reach; }
    const float* columns(int vertex) const { return column[vertex].get(); } // (3 of force, vertices, 3 of displacement)
    bool room() const { return bytes < budget / 8 * 7; }
    bool columns_would_not_fit(int count) const { return count * column_bytes() > budget / 2; }
    // These are in use from now on, and others no longer; evicts what is over the budget.
    void use(const int* vertices, int count);
    // The displacement of all vertices under loads (count, 3) N, without tables: (vertices, 3) mm.
    void solve(const int* vertices, int count, const double* load, float* out);
    std::atomic<size_t> bytes{0};
    std::atomic<int64_t> made_near{0}, made_columns{0}, evicted{0};

    // --- the thread that reads
    // Between open() and close() nothing that find() reads is thrown away.
    void open() { epoch.fetch_add(1); }
    void close() { epoch.fetch_add(1); }
    // A block that is asked for: G_ij, row by row along i, goes to out once it is made.
    struct Wanted {
        int i, j;
        float* out;
        bool found;
    };
    // Tables lie far apart and few of them in a cache, so the waits for them overlap: all are called for before any is
    // read.
    void find(Wanted* wanted, int count) const;

private:
    // A vertex's blocks in one piece of memory, found by reading few lines of it: the first of each sixteen others, the
    // others (rising), then their blocks (3 of displacement, 3 of this vertex's force).
    struct alignas(64) Near {
        static constexpr int line = 16; // numbers
        int count, lines, groups;       // others; lines of others; lines of their first ones
        int* first() { return reinterpret_cast<int*>(this + 1); }
        const int* first() const { return reinterpret_cast<const int*>(this + 1); }
        int* other() { return first() + line * groups; }
        const int* other() const { return first() + line * groups; }
        float* block() { return reinterpret_cast<float*>(other() + line * lines); }
        const float* block() const { return reinterpret_cast<const float*>(other() + line * lines); }
        size_t bytes() const {
            return sizeof(Near) + sizeof(int) * line * (groups + lines) + 9 * sizeof(float) * count;
        }
        static Near* make(int count);
        void list(const int* others);
        int line_of(int vertex) const; // where it would be, or -1
        int place(int vertex, int in_line) const;
    };
    const Elastic& elastic;
    const size_t budget;
    std::vector<std::atomic<const Near*>> near;
    std::vector<double> reached; // mm, of the blocks made; 0: none
    std::vector<std::unique_ptr<float[]>> column;
    std::vector<int64_t> used; // when each vertex was last in use
    int64_t now = 0;
    std::atomic<uint64_t> epoch{0}; // odd while the reader reads
    std::vector<std::pair<const Near*, uint64_t>> retired;
    PartialSolve<float> partial, one;
    std::vector<float> load, result;
    std::vector<int> loaded, wanted, others, mine;
    size_t column_bytes() const { return 9 * sizeof(float) * size_t(elastic.vertices()); }
    void find_some(Wanted* wanted, int count) const;
    void drop_near(int vertex);
    void drop_column(int vertex);
    void sweep_retired();
    void evict();
    void set_load(const int* vertices, int count);
};

} // namespace palpate
