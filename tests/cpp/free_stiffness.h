// The stiffness of the patch test's cube among its free nodes, as the factorisation takes it.
#pragma once
#include "linalg/block_csr.h"
#include "patch_test.h"

namespace palpate::patch_test {

constexpr int fixed = 4; // nodes, the bottom's: they come first

inline BlockCsr free_stiffness() {
    const std::vector<double> K = dense_stiffness();
    BlockCsr rows;
    for (int i = fixed; i < nodes; i++) {
        for (int j = fixed; j < nodes; j++) {
            rows.column.push_back(j - fixed);
            for (int e = 0; e < 9; e++) rows.block.push_back(K[(3 * i + e / 3) * 3 * nodes + 3 * j + e % 3]);
        }
        rows.start.push_back(int(rows.column.size()));
    }
    return rows;
}

} // namespace palpate::patch_test
