#include "net/json_reader.h"
#include <cmath>

namespace palpate {
namespace {

constexpr int max_depth = 64;
constexpr size_t npos = std::string_view::npos;

bool is_space(char c) { return c == ' ' || c == '\n' || c == '\r' || c == '\t'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }

size_t skip_space(std::string_view t, size_t i) {
    while (i < t.size() && is_space(t[i])) i++;
    return i;
}

// Index of what follows the mark that comes next, or npos if that is another one.
size_t skip_mark(std::string_view t, size_t i, char mark) {
    i = skip_space(t, i);
    return i < t.size() && t[i] == mark ? skip_space(t, i + 1) : npos;
}

// Index after the string that starts at i, or npos.
size_t end_of_string(std::string_view t, size_t i) {
    for (i++; i < t.size(); i++) {
        if (t[i] == '"') return i + 1;
        if (t[i] == '\\') i++;
    }
    return npos;
}

// Index after the value that starts at i, or npos. Brackets must match; what is between them
// is checked when it is read.
size_t end_of_value(std::string_view t, size_t i) {
    char open[max_depth];
    int depth = 0;
    while (i < t.size()) {
        char c = t[i];
        if (c == '"') {
            i = end_of_string(t, i);
            if (i == npos) return npos;
        } else if (c == '{' || c == '[') {
            if (depth == max_depth) return npos;
            open[depth++] = c;
            i++;
        } else if (c == '}' || c == ']') {
            if (!depth || open[--depth] != (c == '}' ? '{' : '[')) return npos;
            i++;
        } else if (is_space(c) || c == ',' || c == ':') {
            if (!depth) return npos;
            i++;
            continue; // within a bracket only
        } else
            while (i < t.size() && !is_space(t[i]) && std::string_view(",:]}[{\"").find(t[i]) == npos) i++;
        if (!depth) return i;
    }
    return npos;
}

} // namespace

JsonReader::JsonReader(std::string_view whole) {
    size_t from = skip_space(whole, 0), to = end_of_value(whole, from);
    if (to != npos && skip_space(whole, to) == whole.size()) text = whole.substr(from, to - from);
}

// The value of the member, or where none is named that of the element.
JsonReader JsonReader::find(const std::string_view* member, int element) const {
    if (text.empty() || text[0] != (member ? '{' : '[')) return {};
    for (size_t i = skip_space(text, 1); i < text.size() && (member ? text[i] == '"' : text[i] != ']');) {
        bool wanted = !member && element-- == 0;
        if (member) {
            const size_t end = end_of_string(text, i);
            if (end == npos) return {};
            wanted = text.substr(i + 1, end - i - 2) == *member;
            i = skip_mark(text, end, ':');
        }
        const size_t end = end_of_value(text, i);
        if (end == npos) return {};
        if (wanted) return JsonReader(text.substr(i, end - i));
        i = skip_mark(text, end, ',');
    }
    return {};
}

// Digits by hand: the library's reading follows the locale.
double JsonReader::number(double otherwise) const {
    size_t i = !text.empty() && text[0] == '-';
    double value = 0;
    int power = 0, digits = 0;
    for (; i < text.size() && is_digit(text[i]); i++, digits++) value = 10 * value + (text[i] - '0');
    if (i < text.size() && text[i] == '.')
        for (i++; i < text.size() && is_digit(text[i]); i++, digits++, power--) value = 10 * value + (text[i] - '0');
    if (!digits) return otherwise;
    if (i < text.size() && (text[i] == 'e' || text[i] == 'E')) {
        int exponent = 0, sign = 1;
        size_t from = ++i;
        if (i < text.size() && (text[i] == '+' || text[i] == '-')) sign = text[i++] == '-' ? -1 : 1, from = i;
        for (; i < text.size() && is_digit(text[i]); i++)
            if (exponent < 1000) exponent = 10 * exponent + (text[i] - '0');
        if (i == from) return otherwise;
        power += sign * exponent;
    }
    if (i != text.size()) return otherwise;
    value *= std::pow(10.0, power);
    return text[0] == '-' ? -value : value;
}

std::string_view JsonReader::string() const {
    if (text.size() < 2 || text[0] != '"') return {};
    return text.substr(1, text.size() - 2);
}

} // namespace palpate
