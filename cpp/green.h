#pragma once
#include "halves.h"
#include "partial.h"
#include <atomic>
#include <memory>

namespace palpate {

// The compliance between vertices: blocks G_ij (3x3, mm/N, of K^-1) among those near each other, for forces, and whole
// columns over all vertices, for displays. Made as they are needed, by one thread at a time; the least recently used
// ones go when they take more than a budget, never one that was named in use. Blocks may be read by one other thread
// while they are made: no lock, no wait.
class Green {
public:
    Green(const Elastic& elastic, size_t budget); // bytes
    ~Green();

    static constexpr int batch = Halves::batch;

    // --- the thread that makes them
    // Blocks of these vertices (at most `batch`) with each other and with all within `reach` mm that have theirs.
    void make_near(const int* vertices, int count, double reach);
    void make_columns(const int* vertices, int count);
    bool near_made(int vertex, double reach) const { return reached[vertex] >= reach; }
    const float* columns(int vertex) const { return column[vertex].get(); } // (3 of force, vertices, 3 of displacement)
    // For what nobody asked for yet: where halves that are still of use had to go, it would cost as many again.
    bool room() const { return bytes < budget / 8 * 7 && !crowded; }
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
    // The displacement of a vertex under forces on another, once it is known.
    struct Block {
        float value[9]; // 3 of displacement, 3 of the lower vertex's force
        std::atomic<int32_t> known;
    };
    // A vertex's blocks with those of higher numbers and itself, in one piece of memory, found by reading few lines of
    // it: the first of each sixteen others, the others (rising), then their blocks.
    struct alignas(64) Near {
        static constexpr int line = 16; // numbers
        int count, lines, groups;       // others; lines of others; lines of their first ones
        int* first() { return reinterpret_cast<int*>(this + 1); }
        const int* first() const { return reinterpret_cast<const int*>(this + 1); }
        int* other() { return first() + line * groups; }
        const int* other() const { return first() + line * groups; }
        Block* block() { return reinterpret_cast<Block*>(other() + line * lines); }
        const Block* block() const { return reinterpret_cast<const Block*>(other() + line * lines); }
        size_t bytes() const { return sizeof(Near) + sizeof(int) * line * (groups + lines) + sizeof(Block) * count; }
        static Near* make(const std::vector<int>& others);
        int line_of(int vertex) const; // where it would be, or -1
        int place(int vertex, int in_line) const;
        Block* find(int vertex); // or null
    };
    const Elastic& elastic;
    const size_t budget;
    std::vector<std::atomic<Near*>> near;
    std::vector<double> reached; // mm, of the blocks made
    std::vector<std::unique_ptr<float[]>> column;
    std::vector<int64_t> used; // when each vertex was last in use
    int64_t now = 0;
    std::atomic<uint64_t> epoch{0}; // odd while the reader reads
    std::vector<std::pair<Near*, uint64_t>> retired;
    Halves halves;
    size_t counted = 0; // of their bytes
    bool crowded = false;
    PartialSolve<float> partial;
    const Supernodes& tree;
    Substitution<float> one;
    std::vector<uint8_t> mark;
    std::vector<int> path, shown; // supernodes: of the loads, of all vertices
    std::vector<float> load, result;
    std::vector<int> loaded, others, lacking;
    struct Pair {
        int of, with; // the one that is made, the other
        Block* block;
    };
    std::vector<Pair> pairs;
    size_t column_bytes() const { return 9 * sizeof(float) * size_t(elastic.vertices()); }
    void find_some(Wanted* wanted, int count) const;
    void list_near(int vertex, double reach);
    void find_pairs(const int* vertices, int count);
    void make_halves(const int* vertices, int count);
    void trim_halves();
    bool of_use(int vertex) const;
    void drop_near(int vertex);
    void drop_column(int vertex);
    void sweep_retired();
    void evict();
    void set_load(const int* vertices, int count);
};

} // namespace palpate
