#pragma once
// A body of ellipsoids and boxes, each of one material, in vacuum.
#include <algorithm>
#include <cstdint>

namespace palpate {

struct Body {
    static constexpr int64_t numbers = 12;
    const int64_t* material; // (parts); a later part replaces an earlier one where both are
    const double* solid; // (parts, numbers): centre and radii of an ellipsoid, then corners of a box that cuts it; mm
    int64_t parts;
    double low[3], high[3]; // a box around all of them

    // -1 outside.
    int64_t material_at(const double p[3]) const {
        for (int64_t k = parts - 1; k >= 0; k--) {
            const double* s = solid + k * numbers;
            double square = 0;
            bool inside = true;
            for (int i = 0; i < 3; i++) {
                const double u = (p[i] - s[i]) / s[3 + i];
                square += u * u;
                inside = inside && p[i] >= s[6 + i] && p[i] <= s[9 + i];
            }
            if (inside && square <= 1) return material[k];
        }
        return -1;
    }

    // Moves p along d to where it enters the box; false if it never does.
    bool enter(double p[3], const double d[3]) const {
        double from = 0, to = 1e30;
        for (int i = 0; i < 3; i++) {
            if (d[i] == 0) {
                if (p[i] < low[i] || p[i] > high[i]) return false;
                continue;
            }
            const double a = (low[i] - p[i]) / d[i], b = (high[i] - p[i]) / d[i];
            from = std::max(from, std::min(a, b)), to = std::min(to, std::max(a, b));
        }
        if (from >= to) return false;
        for (int i = 0; i < 3; i++) p[i] += from * d[i];
        return true;
    }
    bool contains(const double p[3]) const {
        for (int i = 0; i < 3; i++)
            if (p[i] < low[i] || p[i] > high[i]) return false;
        return true;
    }
};

} // namespace palpate
