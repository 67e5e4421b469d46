#include "linalg/block_csr.h"

namespace palpate {

void invert_block(const double* a, double* out) {
    double c[9] = {a[4] * a[8] - a[5] * a[7], a[2] * a[7] - a[1] * a[8], a[1] * a[5] - a[2] * a[4],
                   a[5] * a[6] - a[3] * a[8], a[0] * a[8] - a[2] * a[6], a[2] * a[3] - a[0] * a[5],
                   a[3] * a[7] - a[4] * a[6], a[1] * a[6] - a[0] * a[7], a[0] * a[4] - a[1] * a[3]};
    double determinant = a[0] * c[0] + a[1] * c[3] + a[2] * c[6];
    for (int k = 0; k < 9; k++) out[k] = c[k] / determinant;
}

HalfBlockCsr::HalfBlockCsr(const BlockCsr& K, const uint8_t* excluded) {
    diagonal.assign(12 * size_t(K.nodes()), 0);
    inverse.assign(12 * size_t(K.nodes()), 0);
    for (int i = 0; i < K.nodes(); i++) {
        int second = 0; // whether the next block is the second of a pair
        for (int k = K.start[i]; k < K.start[i + 1] && !(excluded && excluded[i]); k++) {
            const int j = K.column[k];
            const double* from = &K.block[9 * size_t(k)];
            if (j == i) {
                double inverted[9];
                invert_block(from, inverted);
                for (int a = 0; a < 3; a++)
                    for (int b = 0; b < 3; b++) {
                        diagonal[12 * size_t(i) + 4 * a + b] = float((from[3 * a + b] + from[3 * b + a]) / 2);
                        inverse[12 * size_t(i) + 4 * a + b] = float((inverted[3 * a + b] + inverted[3 * b + a]) / 2);
                    }
            }
            if (j >= i || (excluded && excluded[j])) continue;
            if (second == 0) {
                block.resize(block.size() + 24, 0.0f);
                column.push_back(4 * j), column.push_back(4 * j); // the second block stays zero if none follows
            } else {
                column.back() = 4 * j;
            }
            float* rows = &block[block.size() - 24 + 4 * second];
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) rows[8 * a + b] = float(from[3 * a + b]);
            second = 1 - second;
        }
        start.push_back(int(column.size() / 2));
    }
}

} // namespace palpate
