#pragma once
// SHA-1 (FIPS 180-4) and base64 for the WebSocket handshake, which uses them only to recognise the protocol.
#include <cstdint>
#include <string>

namespace palpate {

inline std::string sha1(std::string text) {
    auto turn = [](uint32_t x, int n) { return x << n | x >> (32 - n); };
    uint32_t h[5] = {0x67452301, 0xEFCDAB89, 0x98BADCFE, 0x10325476, 0xC3D2E1F0};
    const uint64_t bits = 8 * uint64_t(text.size());
    text += char(0x80);
    while (text.size() % 64 != 56) text += char(0);
    for (int i = 7; i >= 0; i--) text += char(bits >> (8 * i));
    for (size_t block = 0; block < text.size(); block += 64) {
        uint32_t w[80];
        for (int i = 0; i < 80; i++) {
            w[i] = 0;
            if (i < 16)
                for (int b = 0; b < 4; b++) w[i] = w[i] << 8 | uint8_t(text[block + 4 * size_t(i) + size_t(b)]);
            else
                w[i] = turn(w[i - 3] ^ w[i - 8] ^ w[i - 14] ^ w[i - 16], 1);
        }
        uint32_t a = h[0], b = h[1], c = h[2], d = h[3], e = h[4];
        for (int i = 0; i < 80; i++) {
            uint32_t f = i < 20   ? ((b & c) | (~b & d)) + 0x5A827999
                         : i < 40 ? (b ^ c ^ d) + 0x6ED9EBA1
                         : i < 60 ? ((b & c) | (b & d) | (c & d)) + 0x8F1BBCDC
                                  : (b ^ c ^ d) + 0xCA62C1D6;
            uint32_t next = turn(a, 5) + f + e + w[i];
            e = d, d = c, c = turn(b, 30), b = a, a = next;
        }
        h[0] += a, h[1] += b, h[2] += c, h[3] += d, h[4] += e;
    }
    std::string digest;
    for (uint32_t word : h)
        for (int i = 3; i >= 0; i--) digest += char(word >> (8 * i));
    return digest;
}

inline std::string base64(const std::string& bytes) {
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    for (size_t i = 0; i < bytes.size(); i += 3) {
        uint32_t three = 0;
        for (size_t k = 0; k < 3; k++) three = three << 8 | (i + k < bytes.size() ? uint8_t(bytes[i + k]) : 0);
        for (size_t k = 0; k < 4; k++) out += i + k <= bytes.size() ? letters[three >> (18 - 6 * k) & 63] : '=';
    }
    return out;
}

} // namespace palpate
