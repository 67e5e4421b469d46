// Limited-memory BFGS (J. Nocedal, Math. Comp. 35 (1980) 773). Used by hyperelastic/, on the thread of the simulation.
#pragma once
#include <cstddef>
#include <vector>

namespace palpate {

double inner(const double* a, const double* b, int n);      // a'b
void add(double factor, const double* x, double* y, int n); // y += factor x

// The last steps s of a descent, the changes y of the gradient that they made, and the approximation of the inverse
// Hessian that follows from them and a first one, H. A product with H is expensive, so H y is stored with each pair and
// a search direction needs no further product. Allocates only when made.
class Lbfgs {
public:
    Lbfgs(int unknowns, int most);

    int count() const { return used; }
    void clear() { used = 0; }
    // step: s; change: y of the gradient; image: H y. Steps along which the gradient did not grow are left out.
    void put(const double* step, const double* change, const double* image);
    // z = H g becomes the product of the improved inverse Hessian with g.
    void improve(const double* g, double* z);

    // A caller may change the vectors, oldest pair first, and then calls `refresh`, which drops pairs of no curvature.
    double* step(int i) { return &steps[slot(i)]; }
    double* change(int i) { return &changes[slot(i)]; }
    double* image(int i) { return &images[slot(i)]; }
    void refresh();

private:
    const int n, most;
    int first = 0, used = 0;
    std::vector<double> steps, changes, images, product, alpha, rest; // product: s'y of each
    size_t slot(int i) const { return size_t((first + i) % most) * n; }
    bool curved(int i);
};

} // namespace palpate
