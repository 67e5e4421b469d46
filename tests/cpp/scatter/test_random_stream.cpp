// The generators as their authors define them, checked by published outputs, give the stream's numbers.
#include "scatter/random_stream.h"
#include <array>
#include <cmath>
#include <doctest.h>

using palpate::RandomStream;

namespace {

// S. Vigna's splitmix64.c.
uint64_t split_mix(uint64_t& state) {
    state += 0x9e3779b97f4a7c15u;
    uint64_t z = state;
    z ^= z >> 30, z *= 0xbf58476d1ce4e5b9u;
    z ^= z >> 27, z *= 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

// xoshiro256+ of D. Blackman & S. Vigna, as what each word becomes in a step.
uint64_t xoshiro(std::array<uint64_t, 4>& s) {
    const auto [a, b, c, d] = s;
    const uint64_t turned = d ^ b;
    s = {a ^ d ^ b, b ^ c ^ a, c ^ a ^ (b << 17), turned << 45 | turned >> 19};
    return a + d;
}

} // namespace

TEST_CASE("the generators give their published outputs") {
    uint64_t state = 1234567;
    for (uint64_t expected : {6457827717110365317u, 3203168211198807973u, 9817491932198370423u})
        CHECK(split_mix(state) == expected);
    std::array<uint64_t, 4> s{1, 2, 3, 4};
    for (uint64_t expected : {5ul, 211106232532999ul, 211106635186183ul, 9223759065350669058ul})
        CHECK(xoshiro(s) == expected);
}

TEST_CASE("a stream is xoshiro256+ from words by SplitMix64, uniform above 0 and up to 1") {
    for (uint64_t seed : {0u, 1u, 77u})
        for (uint64_t number : {0u, 1u, 1000000u}) {
            uint64_t state = seed * 0xd1342543de82ef95u ^ (number + 1) * 0x2545f4914f6cdd1du;
            std::array<uint64_t, 4> s;
            for (uint64_t& word : s) word = split_mix(state);
            RandomStream stream(seed, number);
            for (int k = 0; k < 100; k++) CHECK(stream.uniform() == std::ldexp(double((xoshiro(s) >> 11) + 1), -53));
        }
}
