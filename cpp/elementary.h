#pragma once
#include "dispatch.h"
#include <cstdint>
#include <cstring>

namespace palpate {

PALPATE_INLINE double double_of(int64_t i) {
    double x;
    std::memcpy(&x, &i, 8);
    return x;
}
PALPATE_INLINE int64_t bits_of(double x) {
    int64_t i;
    std::memcpy(&i, &x, 8);
    return i;
}

// e^x to within 2 units in the last place, x limited to ±700. Neither branch nor call, so a loop over it becomes vector
// code. x = k ln 2 + r, |r| <= ln 2 / 2, and the Taylor polynomial of e^r.
PALPATE_INLINE double fast_exp(double x) {
    constexpr double to_whole =
        6755399441055744.0; // 1.5·2^52: adding it leaves the nearest whole number in the low bits
    x = x < -700 ? -700 : x > 700 ? 700 : x;
    const double shifted = x * 1.4426950408889634 + to_whole, k = shifted - to_whole;
    const double r = (x - k * 0.6931471803691238) - k * 1.9082149292705877e-10; // ln 2 in two parts
    constexpr double inverse[] = {1 / 39916800.0, 1 / 3628800.0, 1 / 362880.0, 1 / 40320.0, 1 / 5040.0, 1 / 720.0,
                                  1 / 120.0,      1 / 24.0,      1 / 6.0,      0.5,         1.0,        1.0};
    double e = 1 / 479001600.0;
    for (double c : inverse) e = e * r + c;
    return double_of(bits_of(e) + (bits_of(shifted) << 52));
}

// log x to within 3 units in the last place of 1 + |log x|, x > 0 and normal. x = 2^k m, m from √½ to √2, and log m = 2
// artanh((m − 1)/(m + 1)).
PALPATE_INLINE double fast_log(double x) {
    constexpr int64_t root_half = 0x3fe6a09e667f3bcd;
    const int64_t above = bits_of(x) - root_half + (int64_t(1023) << 52); // biased, so that the shift needs no sign
    const int64_t k = int64_t(uint64_t(above) >> 52);
    const double m = double_of(bits_of(x) - ((k - 1023) << 52)), s = (m - 1) / (m + 1), s2 = s * s;
    constexpr double odd[] = {1 / 19.0, 1 / 17.0, 1 / 15.0, 1 / 13.0, 1 / 11.0, 1 / 9.0, 1 / 7.0, 0.2, 1 / 3.0, 1.0};
    double sum = 1 / 21.0;
    for (double c : odd) sum = sum * s2 + c;
    const double doublings = double_of(k | 0x4330000000000000) - 4503599627370496.0 - 1023; // k as a double
    return doublings * 0.6931471805599453 + 2 * s * sum;
}

} // namespace palpate
