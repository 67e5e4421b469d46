#pragma once
// Reads single values of a JSON message in place, for the Haply driver, on its thread: nothing is copied or allocated.
// The text may come from anyone: what is missing or malformed is an empty value.
#include <string_view>

namespace palpate {

class JsonReader {
    std::string_view text; // of one value, without surrounding space; empty: missing
    JsonReader find(const std::string_view* member, int element) const;

public:
    JsonReader() = default;
    explicit JsonReader(std::string_view text); // of a whole message
    JsonReader operator[](std::string_view member) const { return find(&member, 0); }
    JsonReader operator[](int element) const { return find(nullptr, element); }
    bool exists() const { return !text.empty(); }
    bool is_true() const { return text == "true"; }
    double number(double otherwise) const;
    std::string_view string() const; // as written between the quotes; escapes are left as they are
};

} // namespace palpate
