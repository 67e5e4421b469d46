// exp, log and power without branches or calls, so that loops over them become vector code. Used by the likelihood,
// the potentials and the phantom's transmission.
#pragma once
#include "base/cpu_dispatch.h"
#include <cstdint>
#include <cstring>

namespace palpate {

// The bits of x as another type of the same size.
template <class To, class From> PALPATE_INLINE To bits_as(From x) {
    To same;
    std::memcpy(&same, &x, sizeof same);
    return same;
}
PALPATE_INLINE double double_of(int64_t i) { return bits_as<double>(i); }
PALPATE_INLINE float float_of(int32_t i) { return bits_as<float>(i); }
PALPATE_INLINE int64_t bits_of(double x) { return bits_as<int64_t>(x); }
PALPATE_INLINE int32_t bits_of(float x) { return bits_as<int32_t>(x); }

// x = k ln 2 + r with |r| <= ln 2 / 2, x limited to ±700, and (e^r - 1)/r by its Taylor polynomial.
struct ReducedExp {
    double shifted, r, quotient; // k is in the low bits of `shifted`
};
PALPATE_INLINE ReducedExp reduced_exp(double x) {
    constexpr double to_whole =
        6755399441055744.0; // 1.5·2^52: adding it leaves the nearest whole number in the low bits
    x = x < -700 ? -700 : x > 700 ? 700 : x;
    const double shifted = x * 1.4426950408889634 + to_whole, k = shifted - to_whole;
    const double r = (x - k * 0.6931471803691238) - k * 1.9082149292705877e-10; // ln 2 in two parts
    constexpr double inverse[] = {1 / 39916800.0, 1 / 3628800.0, 1 / 362880.0, 1 / 40320.0, 1 / 5040.0, 1 / 720.0,
                                  1 / 120.0,      1 / 24.0,      1 / 6.0,      0.5,         1.0};
    double e = 1 / 479001600.0;
    for (double c : inverse) e = e * r + c;
    return {shifted, r, e};
}

// e^x to within 2 units in the last place, x limited to ±700.
PALPATE_INLINE double fast_exp(double x) {
    const ReducedExp part = reduced_exp(x);
    const double e = part.quotient * part.r + 1.0;
    return double_of(int64_t(uint64_t(bits_of(e)) + (uint64_t(bits_of(part.shifted)) << 52)));
}

// e^x - 1 to within 4 units in the last place, near 0 too, x limited to ±700.
PALPATE_INLINE double fast_expm1(double x) {
    const ReducedExp part = reduced_exp(x);
    const double power = double_of(int64_t((uint64_t(bits_of(part.shifted)) + 1023) << 52)); // 2^k
    return power * (part.quotient * part.r) + (power - 1);
}

// log x to within 3 units in the last place of 1 + |log x|, for normal x > 0: x = 2^k m with m from √½ to √2, and
// log m = 2 artanh((m − 1)/(m + 1)).
PALPATE_INLINE double fast_log(double x) {
    constexpr uint64_t root_half = 0x3fe6a09e667f3bcd;
    const auto bits = uint64_t(bits_of(x));
    const int64_t k = int64_t((bits - root_half + (uint64_t(1023) << 52)) >> 52); // biased: the shift needs no sign
    const double m = double_of(int64_t(bits - (uint64_t(k - 1023) << 52))), s = (m - 1) / (m + 1), s2 = s * s;
    constexpr double odd[] = {1 / 19.0, 1 / 17.0, 1 / 15.0, 1 / 13.0, 1 / 11.0, 1 / 9.0, 1 / 7.0, 0.2, 1 / 3.0, 1.0};
    double sum = 1 / 21.0;
    for (double c : odd) sum = sum * s2 + c;
    const double doublings = double_of(k | 0x4330000000000000) - 4503599627370496.0 - 1023; // k as a double
    return doublings * 0.6931471805599453 + 2 * s * sum;
}

// x^power for x > 0, to about 2e-7 · (1 + |power|), by minimax polynomials of log2(1 + z)/z from √½ to √2 and of 2^y
// from −½ to ½. powf costs four times as much.
PALPATE_INLINE float fast_power(float x, float power) {
    const auto bits = uint32_t(bits_of(x));
    const int32_t exponent = int32_t(bits - 0x3f3504f3u) >> 23; // of x/√½
    float z = float_of(int32_t(bits - (uint32_t(exponent) << 23))) - 1;
    float log2 = -0.14973146f;
    constexpr float of_log[] = {0.23570909f, -0.24832314f, 0.28686896f, -0.36026344f,
                                0.48093116f, -0.72135246f, 1.4426949f};
    for (float c : of_log) log2 = log2 * z + c;
    float y = power * (float(exponent) + z * log2);
    y = y < -126 ? -126 : y > 126 ? 126 : y;
    float whole = (y + 12582912.0f) - 12582912.0f, r = y - whole, e = 0.00132765f; // to the nearest whole number
    constexpr float of_exp[] = {0.00967554f, 0.05550713f, 0.2402212f, 0.69314694f, 1.0f};
    for (float c : of_exp) e = e * r + c;
    return float_of(bits_of(e) + int32_t(whole) * (1 << 23));
}

} // namespace palpate
