// A cube of 2 mm of eight smaller ones, each of six tetrahedra about its diagonal (H. W. Kuhn, IBM J. Res. Dev. 4
// (1960) 518). For the tests of cuts.
#pragma once
#include <cstdint>
#include <utility>
#include <vector>

struct KuhnCube {
    std::vector<double> node;
    std::vector<int32_t> tet;
    KuhnCube() {
        for (int n = 0; n < 27; n++) node.insert(node.end(), {n % 3 * 1.0, n / 3 % 3 * 1.0, n / 9 * 1.0});
        const int step[3] = {1, 3, 9}, order[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
        for (int first : {0, 1, 3, 4, 9, 10, 12, 13})
            for (int k = 0; k < 6; k++) {
                int at[4] = {first};
                for (int d = 0; d < 3; d++) at[d + 1] = at[d] + step[order[k][d]];
                if (k >= 3) std::swap(at[2], at[3]); // odd permutations are mirrored
                tet.insert(tet.end(), at, at + 4);
            }
    }
};
