#pragma once
// A stream of random numbers for each photon: the answer depends on the seed alone, not on the number of threads.
#include <cstdint>

namespace palpate {

// xoshiro256+ (Blackman & Vigna, ACM Trans. Math. Softw. 47:36, 2021), started by SplitMix64 from seed and number.
class RandomStream {
public:
    RandomStream(uint64_t seed, uint64_t number) {
        uint64_t state = seed * 0xd1342543de82ef95u ^ (number + 1) * 0x2545f4914f6cdd1du;
        for (uint64_t& word : s_) {
            uint64_t z = (state += 0x9e3779b97f4a7c15u);
            z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
            z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
            word = z ^ (z >> 31);
        }
    }

    // Uniform in (0, 1]: its logarithm is finite.
    double uniform() {
        const uint64_t result = s_[0] + s_[3], t = s_[1] << 17;
        s_[2] ^= s_[0];
        s_[3] ^= s_[1];
        s_[1] ^= s_[2];
        s_[0] ^= s_[3];
        s_[2] ^= t;
        s_[3] = (s_[3] << 45) | (s_[3] >> 19);
        return double((result >> 11) + 1) * 0x1p-53;
    }

private:
    uint64_t s_[4];
};

} // namespace palpate
