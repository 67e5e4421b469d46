#include "linalg/lbfgs.h"
#include "base/vec3.h"
#include <algorithm>
#include <cmath>

namespace palpate {

PALPATE_KERNEL double inner(const double* a, const double* b, int n) { return dot(a, b, n); }

PALPATE_KERNEL void add(double factor, const double* x, double* y, int n) {
    for (int i = 0; i < n; i++) y[i] += factor * x[i];
}

Lbfgs::Lbfgs(int unknowns, int most)
    : n(unknowns), most(most), steps(size_t(most) * n), changes(steps.size()), images(steps.size()), product(most),
      alpha(most), rest(n) {}

void Lbfgs::put(const double* s, const double* y, const double* image_of_y) {
    if (used == most) first = (first + 1) % most, used--;
    std::copy_n(s, n, step(used));
    std::copy_n(y, n, change(used));
    std::copy_n(image_of_y, n, image(used));
    if (curved(used)) used++;
}

bool Lbfgs::curved(int i) {
    const double sy = inner(step(i), change(i), n), yHy = inner(change(i), image(i), n);
    product[(first + i) % most] = sy;
    return sy > 0 && yHy > 0 && std::isfinite(1 / sy) && sy > 1e-4 * yHy; // softer than H by more: rounding
}

void Lbfgs::refresh() {
    int kept = 0;
    for (int i = 0; i < used; i++) {
        if (!curved(i)) continue;
        if (kept < i) {
            std::copy_n(step(i), n, step(kept));
            std::copy_n(change(i), n, change(kept));
            std::copy_n(image(i), n, image(kept));
            product[(first + kept) % most] = product[(first + i) % most];
        }
        kept++;
    }
    used = kept;
}

void Lbfgs::improve(const double* g, double* z) {
    if (used == 0) return;
    std::copy_n(g, n, rest.begin());
    for (int i = used - 1; i >= 0; i--) {
        alpha[i] = inner(step(i), rest.data(), n) / product[(first + i) % most];
        add(-alpha[i], change(i), rest.data(), n);
        add(-alpha[i], image(i), z, n);
    }
    // The newest pair gives the ratio of H to the inverse stiffness along it; a stiffer tissue scales H down.
    const int newest = used - 1;
    const double stiffer = product[(first + newest) % most] / inner(change(newest), image(newest), n);
    if (stiffer < 1)
        for (int i = 0; i < n; i++) z[i] *= stiffer;
    for (int i = 0; i < used; i++) add(alpha[i] - inner(change(i), z, n) / product[(first + i) % most], step(i), z, n);
}

} // namespace palpate
