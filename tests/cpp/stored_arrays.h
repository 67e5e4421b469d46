// Arrays that an x86-64 run has stored in tests/cpp/data, to hold other processors and compilers against. A run with
// PALPATE_STORE=1 writes them anew, as hexadecimal floats. CMakeLists.txt says where they are: with ccache's base_dir,
// __FILE__ is relative to a folder that the tests may not run in.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <doctest.h>
#include <fstream>
#include <random>
#include <string>
#include <vector>

namespace palpate {

// Uniform in [0, 1): the library's distributions differ from compiler to compiler.
inline std::vector<float> uniform(int64_t count, unsigned seed) {
    std::mt19937 random(seed);
    std::vector<float> out(count);
    for (float& v : out) v = float(random() >> 8) / (1 << 24);
    return out;
}

// The largest difference is at most 1e-5 of the largest value.
template <class T> void check_stored(const std::string& name, const std::vector<T>& values) {
    const std::string path = std::string(PALPATE_STORED_ARRAYS) + "/" + name + ".txt";
    if (std::getenv("PALPATE_STORE")) {
        std::ofstream out(path);
        for (T v : values) out << std::hexfloat << v << '\n';
    }
    std::ifstream in(path);
    std::vector<double> stored;
    for (std::string line; in >> line;) stored.push_back(std::strtod(line.c_str(), nullptr));
    REQUIRE(stored.size() == values.size());
    double largest = 0, difference = 0;
    for (size_t i = 0; i < stored.size(); i++) {
        largest = std::max(largest, std::abs(stored[i]));
        difference = std::max(difference, std::abs(stored[i] - double(values[i])));
    }
    REQUIRE(largest > 0);
    CHECK(difference <= 1e-5 * largest);
    MESSAGE(name, ": ", difference / largest);
}

} // namespace palpate
