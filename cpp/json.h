#pragma once
#include <string_view>

namespace palpate {

// The few things asked of a message in JSON, read in place: nothing is copied or allocated. What is not there, or no
// JSON, is an empty view (or `otherwise`); the text may come from anyone.
class Json {
    std::string_view text; // of one value, without the space around it; empty: nothing

public:
    Json() = default;
    explicit Json(std::string_view text); // of a whole message
    Json operator[](std::string_view member) const;
    Json operator[](int element) const;
    bool exists() const { return !text.empty(); }
    bool is_true() const { return text == "true"; }
    double number(double otherwise) const;
    std::string_view string() const; // as written between the quotes; escapes are left as they are
};

} // namespace palpate
