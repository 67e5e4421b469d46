#include "json.h"
#include <cmath>

namespace palpate {
namespace {

constexpr int deepest = 64;
constexpr size_t nowhere = std::string_view::npos;

bool is_space(char c) { return c == ' ' || c == '\n' || c == '\r' || c == '\t'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }

size_t blank(std::string_view t, size_t i) {
    while (i < t.size() && is_space(t[i])) i++;
    return i;
}

// Index after the string that starts at i, or nowhere.
size_t after_string(std::string_view t, size_t i) {
    for (i++; i < t.size(); i++) {
        if (t[i] == '"') return i + 1;
        if (t[i] == '\\') i++;
    }
    return nowhere;
}

// Index after the value that starts at i, or nowhere. Brackets must match; what stands between them is looked at when
// somebody asks for it.
size_t after(std::string_view t, size_t i) {
    char open[deepest];
    int depth = 0;
    while (i < t.size()) {
        char c = t[i];
        if (c == '"') {
            i = after_string(t, i);
            if (i == nowhere) return nowhere;
        } else if (c == '{' || c == '[') {
            if (depth == deepest) return nowhere;
            open[depth++] = c;
            i++;
        } else if (c == '}' || c == ']') {
            if (!depth || open[--depth] != (c == '}' ? '{' : '[')) return nowhere;
            i++;
        } else if (is_space(c) || c == ',' || c == ':') {
            if (!depth) return nowhere;
            i++;
            continue; // within a bracket only
        } else
            while (i < t.size() && !is_space(t[i]) && std::string_view(",:]}[{\"").find(t[i]) == nowhere) i++;
        if (!depth) return i;
    }
    return nowhere;
}

} // namespace

Json::Json(std::string_view whole) {
    size_t from = blank(whole, 0), to = after(whole, from);
    if (to != nowhere && blank(whole, to) == whole.size()) text = whole.substr(from, to - from);
}

Json Json::operator[](std::string_view member) const {
    if (text.empty() || text[0] != '{') return {};
    for (size_t i = blank(text, 1); i < text.size() && text[i] == '"';) {
        size_t end = after_string(text, i);
        if (end == nowhere) return {};
        std::string_view key = text.substr(i + 1, end - i - 2);
        i = blank(text, end);
        if (i >= text.size() || text[i] != ':') return {};
        i = blank(text, i + 1);
        end = after(text, i);
        if (end == nowhere) return {};
        if (key == member) return Json(text.substr(i, end - i));
        i = blank(text, end);
        if (i >= text.size() || text[i] != ',') return {};
        i = blank(text, i + 1);
    }
    return {};
}

Json Json::operator[](int element) const {
    if (text.empty() || text[0] != '[') return {};
    for (size_t i = blank(text, 1); i < text.size() && text[i] != ']';) {
        size_t end = after(text, i);
        if (end == nowhere) return {};
        if (!element--) return Json(text.substr(i, end - i));
        i = blank(text, end);
        if (i >= text.size() || text[i] != ',') return {};
        i = blank(text, i + 1);
    }
    return {};
}

// Digits by hand: the library's reading follows the locale.
double Json::number(double otherwise) const {
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

std::string_view Json::string() const {
    if (text.size() < 2 || text[0] != '"') return {};
    return text.substr(1, text.size() - 2);
}

} // namespace palpate
