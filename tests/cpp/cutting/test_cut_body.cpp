// A cube cut in two: its parts fill it, its surface is closed, and what nothing holds is gone for later blades.
#include "cutting/cut_body.h"
#include "kuhn_cube.h"
#include <algorithm>
#include <doctest.h>
#include <set>

using namespace palpate;

namespace {

struct Cube : KuhnCube {
    std::vector<uint8_t> held; // where x = 0
    Cube() {
        for (int n = 0; n < 27; n++) held.push_back(n % 3 == 0);
    }
    CutBody cut(const std::vector<std::vector<BladeTriangle>>& cuts, bool holds) const {
        return cut_body(node.data(), 27, tet.data(), int(tet.size() / 4), holds ? held.data() : nullptr, cuts);
    }
};

// All of the plane x.
std::vector<BladeTriangle> plane(double x) {
    const double a[3] = {x, -9, -9}, b[3] = {x, 20, -9}, c[3] = {x, -9, 20};
    return {BladeTriangle(a, b, c)};
}

double volume(const CutBody& body, bool gone) { // each of the cube's tetrahedra has a sixth of a mm^3
    double sum = 0;
    for (size_t t = 0; t < body.mesh.tet.size(); t++)
        if (bool(body.gone[t]) == gone) sum += body.mesh.share[t] / 6;
    return sum;
}

double area(const CutBody& body) {
    double sum = 0;
    for (double a : body.cut_area) sum += a;
    return sum;
}

bool closed(const CutSkin& skin) {
    std::set<std::array<int, 2>> edges;
    for (const auto& t : skin.triangle)
        for (int k = 0; k < 3; k++)
            if (!edges.insert({t[k], t[(k + 1) % 3]}).second) return false;
    return std::all_of(edges.begin(), edges.end(),
                       [&](const auto& edge) { return edges.count({edge[1], edge[0]}) == 1; });
}

} // namespace

TEST_CASE("two halves that nothing holds stay") {
    const CutBody body = Cube().cut({plane(0.9)}, false);
    CHECK(volume(body, false) == doctest::Approx(8).epsilon(1e-12));
    CHECK(area(body) == doctest::Approx(4).epsilon(1e-12));
    CHECK(closed(body.skin));
    CHECK(*std::max_element(body.mesh.body.begin(), body.mesh.body.end()) == 1);
    CHECK(std::set<int>(body.mesh.origin.begin(), body.mesh.origin.begin() + 27).size() == 27);
}

TEST_CASE("the half that nothing holds is gone, and a blade meets nothing there") {
    const Cube cube;
    CutBody body = cube.cut({plane(0.9), plane(1.5), plane(0.4)}, true);
    CHECK(volume(body, true) == doctest::Approx(4 * 1.6).epsilon(1e-12));
    CHECK(area(body) == doctest::Approx(2 * 4).epsilon(1e-12));
    CHECK(closed(body.skin));
    take_away(body);
    CHECK(volume(body, false) == doctest::Approx(4 * 0.4).epsilon(1e-12));
    CHECK(closed(body.skin));
    double far = 0;
    for (size_t v = 0; v < body.skin.tet.size(); v++) {
        double x = 0;
        for (int k = 0; k < 4; k++)
            x += body.skin.weight[4 * v + k] *
                 cube.node[3 * size_t(body.mesh.origin[body.mesh.tet[body.skin.tet[v]][k]])];
        far = std::max(far, x);
    }
    CHECK(far == doctest::Approx(0.4).epsilon(1e-12));
}

TEST_CASE("a node beyond the blade is not real") {
    const Cube cube;
    const CutBody body = cube.cut({plane(0.9)}, true);
    for (size_t t = 0; t < body.mesh.tet.size(); t++)
        for (int node : body.mesh.tet[t]) {
            const double x = cube.node[3 * size_t(body.mesh.origin[node])];
            CHECK(bool(body.mesh.real[node]) == (bool(body.gone[t]) ? x > 0.9 : x < 0.9));
        }
}
