#pragma once
// The cache of Green's functions. One thread computes entries, the loop's thread reads blocks meanwhile without a lock.
#include "compliance/half_solves.h"
#include "linalg/partial_solve.h"
#include <atomic>
#include <memory>

namespace palpate {

// The compliance between vertices: blocks G_ij (3x3, mm/N, of K^-1) of nearby pairs, for forces, and whole columns over
// all vertices, for displays. Entries are computed on request; if they take more than the budget, the least recently
// used ones are evicted, but never one that is marked as used.
class GreensFunctions {
public:
    GreensFunctions(const FactoredStiffness& stiffness, size_t budget); // bytes
    ~GreensFunctions();

    static constexpr int batch = HalfSolves::batch;

    // --- for the thread that computes
    // Blocks of these vertices (at most `batch`) with each other and with all within `reach` mm that have a table.
    void compute_blocks(const int* vertices, int count, double reach);
    void compute_columns(const int* vertices, int count);
    bool has_blocks(int vertex, double reach) const { return table_reach[vertex] >= reach; }
    const float* columns(int vertex) const { return column[vertex].get(); } // (3 of force, vertices, 3 of displacement)
    // Whether to compute entries that no tick has asked for; not if half solves that are still needed were evicted.
    bool has_room() const { return bytes < budget / 8 * 7 && !half_solves_full; }
    bool columns_exceed_budget(int count) const { return count * column_bytes() > budget / 2; }
    // Marks these vertices, and no others, as used; evicts what exceeds the budget.
    void mark_used(const int* vertices, int count);
    // The displacement of all vertices, (vertices, 3) mm, under loads (count, 3) N: from the factors, without tables.
    void solve(const int* vertices, int count, const double* load, float* out);
    // The same as a sum of columns; false if one of the vertices has no columns.
    bool superpose(const int* vertices, int count, const double* load, float* out) const;
    std::atomic<size_t> bytes{0};
    std::atomic<int64_t> blocks_computed{0}, columns_computed{0}, evicted{0}; // vertices, vertices, entries

    // --- for the thread that reads
    // Between begin_read() and end_read() nothing that read() looks at is freed.
    void begin_read() { read_epoch.fetch_add(1); }
    void end_read() { read_epoch.fetch_add(1); }
    // A request for G_ij, row by row along i: written to out if it is known.
    struct BlockRequest {
        int i, j;
        float* out;
        bool found;
    };
    // The tables are scattered in memory and few are in a cache: prefetches the whole batch, so that the misses
    // overlap.
    void read(BlockRequest* requests, int count) const;

private:
    struct Block {
        float value[9]; // 3 of displacement, 3 of the lower vertex's force
        std::atomic<int32_t> known;
    };
    // A vertex's blocks with itself and with vertices of higher numbers, in one piece of memory with a two-level index,
    // so that a search reads few cache lines: the first of each sixteen vertices, the vertices (ascending), the blocks.
    struct alignas(64) BlockTable {
        static constexpr int line = 16; // vertices per cache line
        int count, lines, index_lines;  // vertices; cache lines of vertices; cache lines of their first ones
        int* first() const { return reinterpret_cast<int*>(const_cast<BlockTable*>(this) + 1); }
        int* vertex() const { return first() + line * index_lines; }
        Block* block() const { return reinterpret_cast<Block*>(vertex() + line * lines); }
        size_t bytes() const {
            return sizeof(BlockTable) + sizeof(int) * line * (index_lines + lines) + sizeof(Block) * count;
        }
        static BlockTable* make(const std::vector<int>& vertices);
        static void release(BlockTable* table);
        int line_of(int v) const; // the line that may hold v, or -1
        int index_in_line(int v, int in_line) const;
        Block* find(int v); // or null
    };
    const FactoredStiffness& stiffness;
    const size_t budget;
    std::vector<std::atomic<BlockTable*>> table; // (vertices) or null
    std::vector<double> table_reach;             // (vertices) mm, of the blocks computed
    std::vector<std::unique_ptr<float[]>> column;
    std::vector<int64_t> last_used;      // (vertices) value of use_count
    int64_t use_count = 0;               // calls of mark_used()
    std::atomic<uint64_t> read_epoch{0}; // odd while the reader reads
    std::vector<std::pair<BlockTable*, uint64_t>> retired;
    HalfSolves half_solves;
    size_t half_solve_bytes = 0; // included in `bytes`
    bool half_solves_full = false;
    PartialSolve<float> partial;
    const Supernodes& tree;
    TriangularSolve<float> full;
    std::vector<uint8_t> mark;
    std::vector<int> load_path, vertex_path; // supernodes between the loads and the root, all vertices and the root
    std::vector<float> load, result;
    std::vector<int> loaded, nearby, missing;
    struct Pair {
        int vertex, other; // the one asked for, and one that has a table
        Block* block;
    };
    std::vector<Pair> pairs;
    size_t column_bytes() const { return 9 * sizeof(float) * size_t(stiffness.vertices()); }
    void read_some(BlockRequest* requests, int count) const;
    void make_table(int vertex, double reach);
    void find_pairs(const int* vertices, int count);
    void compute_half_solves(const int* vertices, int count);
    void trim_half_solves();
    std::vector<int> least_recent(const std::vector<int>& vertices) const;
    bool half_solve_needed(int vertex) const;
    void drop_table(int vertex);
    void drop_column(int vertex);
    void free_retired();
    void evict();
    void set_load(const int* vertices, int count);
};

} // namespace palpate
