#pragma once
// Sparse matrices as Python hands them over, copied. For the bindings of linalg and relaxation.
#include "bindings/module.h"
#include "linalg/block_csr.h"
#include <algorithm>

namespace palpate {

// start: (nodes + 1), rising from 0; column: (start[nodes]), each the number of a node.
inline SparsityPattern sparsity_pattern(In<int32_t, 1> start, In<int32_t, 1> column) {
    const char* wrong = "matrix: expected compressed rows";
    expect(start.size() > 0 && start(0) == 0 && std::is_sorted(start.data(), start.data() + start.size()), wrong);
    const size_t nodes = start.size() - 1;
    expect(size_t(start(nodes)) == column.size(), wrong);
    expect_numbers(column, nodes, wrong);
    return {listed(start), listed(column)};
}

// block: (start[nodes], 3, 3).
inline BlockCsr block_csr(In<int32_t, 1> start, In<int32_t, 1> column, In<double, 3> block) {
    expect(block.shape(0) == column.size() && block.shape(1) == 3 && block.shape(2) == 3, "block: expected (n, 3, 3)");
    return {sparsity_pattern(start, column), {block.data(), block.data() + block.size()}};
}

} // namespace palpate
