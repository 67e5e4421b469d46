#pragma once
// The blocks of Green's functions that a tick's patches need. ComplianceModel uses it in the loop's thread.
#include "compliance/greens_functions.h"
#include "tissue/tissue_model.h"

namespace palpate {

// The vertices of all patches together, ascending, each once.
struct PatchVertices {
    static constexpr int max_entries = TissueModel::max_patches * ContactPatch::capacity;
    int entries = 0, count = 0; // nodes of all patches; vertices
    int vertex[max_entries];    // the first `count`
    int source[max_entries];    // of each entry: patch * ContactPatch::capacity + its place in the patch
    int index[max_entries];     // of each entry: its place in `vertex`
    // False if they are more than ContactPatch::capacity.
    bool gather(const FactoredStiffness& stiffness, const ContactPatch* patches, int count);
};

// The blocks G_ij of each pair i >= j of those vertices, at i (i + 1) / 2 + j, closely packed so that a tick that finds
// the caches cold reads little. Allocates only when it is made.
struct PatchBlocks {
    PatchBlocks();
    bool covers(const int* vertices, int n) const {
        return n == count && std::equal(vertices, vertices + n, vertex.begin());
    }
    // Becomes the pairs of these vertices, with the blocks that `old` has of them.
    void carry_over(const PatchBlocks& old, const int* vertices, int count);
    // Reads the missing blocks that have been computed since the last call.
    void fetch(GreensFunctions& greens);
    // Sum over all i, j of w_i w_j G_ij; and between two patches, of v_i w_j G_ij. v, w: (count).
    void compliance(const double* w, double out[9]) const;
    void compliance(const double* v, const double* w, double out[9]) const;
    void apply(const double* load, double* out) const; // out_i = sum over j of G_ij load_j, (count, 3)
    bool contains(int v) const { return std::binary_search(vertex.begin(), vertex.begin() + count, v); }

    int count = 0;
    std::vector<int> vertex;    // (capacity)
    std::vector<float> block;   // (pairs, 9)
    std::vector<uint8_t> known; // (pairs)
    int missing = 0;            // pairs that are not known
    int64_t checked = -1;       // GreensFunctions::blocks_computed at the last fetch()
};

} // namespace palpate
