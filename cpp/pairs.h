#pragma once
#include <cstddef>
#include <vector>

namespace palpate {

double inner(const double* a, const double* b, int n);      // a'b
void add(double factor, const double* x, double* y, int n); // y += factor x

// The last steps of a descent with what they did to the gradient, and the inverse Hessian that they imply from a first
// guess H: limited-memory BFGS (J. Nocedal, Math. Comp. 35 (1980) 773). H is dear, so its images are kept beside the
// changes and a direction needs no product with it. Sized once.
class Pairs {
public:
    Pairs(int unknowns, int most);

    int count() const { return used; }
    void clear() { used = 0; }
    // step: s; change: y of the gradient; image: H y. Steps along which the gradient did not grow are left out.
    void put(const double* step, const double* change, const double* image);
    // z = H g becomes the better inverse's product with g.
    void improve(const double* g, double* z);

    // For who must change the pairs' vectors, oldest first; `refresh` afterwards drops what is no use any more.
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
