#include "hyperelastic/local_force.h"
#include <algorithm>
#include <cmath>

namespace palpate {

// d = s d0 + p, p normal to d0; with t = s - 1
//   P = a(s) + b(s).p + q(s) p'Kp / 2,
//   a = s^3 (a0 + a1 t + a2 t^2), b = s^2 (g + (K d0 - 2 g) t), q = s^2 (3 - 2 s)    between rest and d0,
//   a, b, q of the Taylor series beyond, with w (1 - exp(-t / w)) for t in the second order, and second and third
//   derivatives of a times exp(-t / w).
double LocalForce::add_force(const double* d, double* out, double scale) const {
    const int n = 3 * contacts;
    double square = 0, along = 0;
    for (int k = 0; k < n; k++) square += displacement[k] * displacement[k], along += displacement[k] * d[k];
    if (!(square > 1e-12) || !(along > 0)) return 0;
    const double s = along / square, t = s - 1;
    double p[most], Kd[most], Kp[most], gd = 0, dKd = 0, gp = 0, dKp = 0, pKp = 0;
    for (int k = 0; k < n; k++) p[k] = d[k] - s * displacement[k];
    for (int i = 0; i < n; i++) {
        Kd[i] = Kp[i] = 0;
        for (int j = 0; j < n; j++) {
            Kd[i] += curvature[n * i + j] * displacement[j];
            Kp[i] += curvature[n * i + j] * p[j];
        }
        gd += gradient[i] * displacement[i], dKd += displacement[i] * Kd[i];
        gp += gradient[i] * p[i], dKp += Kd[i] * p[i], pKp += p[i] * Kp[i];
    }
    double value, slope; // P and its derivative by s
    double bg, bk, q;    // b = bg g + bk K d0
    if (t >= 0) {
        const double left = std::exp(-t / fading);
        bg = 1, bk = fading * (1 - left), q = 1;
        double second = dKd, third = 0;
        if (stiffens && energy > 0 && gd > 2 * energy) {
            const double power = std::min(gd / energy, most_power);
            second = std::max(dKd, gd * (power - 1)), third = gd * (power - 1) * (power - 2);
        }
        value = energy + gd * t + second * fading * (t - bk) + gp + dKp * bk + pKp / 2 +
                third * fading * fading * (t - 2 * fading + (2 * fading + t) * left);
        slope = gd + second * bk + dKp * left + third * fading * (fading - (fading + t) * left);
    } else {
        const double a0 = energy, a1 = gd - 3 * a0, a2 = (dKd - 6 * a0 - 6 * a1) / 2;
        bg = s * s * (1 - 2 * t), bk = s * s * t, q = s * s * (3 - 2 * s);
        value = s * s * s * (a0 + a1 * t + a2 * t * t) + bg * gp + bk * dKp + q * pKp / 2;
        slope = 3 * s * s * (a0 + a1 * t + a2 * t * t) + s * s * s * (a1 + 2 * a2 * t) +
                (2 * s * (1 - 2 * t) - 2 * s * s) * gp + (2 * s * t + s * s) * dKp + 3 * s * (1 - s) * pKp;
    }
    // By p the gradient is v = b + q K p without its part along d0, which s takes.
    double v[most], vd = 0;
    for (int k = 0; k < n; k++) {
        v[k] = bg * gradient[k] + bk * Kd[k] + q * Kp[k];
        vd += v[k] * displacement[k];
    }
    for (int k = 0; k < n; k++) out[k] += scale * (v[k] + (slope - vd) / square * displacement[k]);
    return scale * value;
}

} // namespace palpate
