// One gap under one tool, whose compliances are all 1 mm/N: gap and slips are the tool's way plus the forces.
#include "compliance/gap_constraints.h"
#include <cmath>
#include <doctest.h>
#include <vector>

using namespace palpate;

namespace {

constexpr double stiffness[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}; // N/mm of the tool's patch

GapConstraints one_gap(double friction, double rest, double give) {
    GapConstraints gaps;
    gaps.count = 1, gaps.friction = friction, gaps.rows = friction > 0 ? 3 : 1, gaps.stride = 16;
    gaps.rest = {rest}, gaps.give = {give};
    gaps.between = AlignedBuffer(size_t(gaps.rows) * gaps.stride);
    gaps.response = AlignedBuffer(3 * size_t(gaps.stride)); // of one vertex: x opens the gap, y and z are its slips
    for (int k = 0; k < gaps.rows; k++) {
        gaps.between[size_t(k) * gaps.stride + k] = 2; // 1 is left with the tool held
        gaps.response[size_t(k) * gaps.stride + k] = 1;
        gaps.first.push_back(k), gaps.node.push_back(0);
        for (int c = 0; c < 3; c++) gaps.share.push_back(c == k);
    }
    gaps.first.push_back(gaps.rows);
    return gaps;
}

struct Tool {
    GapConstraints gaps;
    GapSolver solver{gaps, 1};
    std::vector<double> p = std::vector<double>(gaps.numbers(), 0.0);
    Tool(double friction, double rest = 1, double give = 0) : gaps(one_gap(friction, rest, give)) {
        const int vertex = 0;
        const double weight = 1;
        solver.set_patch(0, &vertex, &weight, 1);
    }
    double to(double x, double y, double z) {
        const double way[3] = {x, y, z};
        return solver.solve(stiffness, way, 3, 50, p.data());
    }
};

} // namespace

TEST_CASE("a gap that is left open bears no force, and one that is closed as much as closes it") {
    Tool tool(0);
    CHECK(tool.to(-0.9, 0, 0) == 0);
    CHECK(tool.p[0] == 0);
    tool.to(-3, 5, 0);
    CHECK(tool.p[0] == doctest::Approx(2));
    CHECK(tool.gaps.energy(tool.p.data()) == doctest::Approx(-1)); // half of 2 N times the 1 mm by which it is closed
    tool.to(0, 0, 0);
    CHECK(tool.p[0] == 0);
}

TEST_CASE("a spring across a gap pulls and pushes") {
    Tool tool(0.5, 0, 3);
    tool.to(-2, 0, 0);
    CHECK(tool.p[0] == doctest::Approx(2.0 / 4));
    tool.to(2, 7, 0);
    CHECK(tool.p[0] == doctest::Approx(-2.0 / 4));
    CHECK(tool.p[1] == 0); // and does not rub
}

TEST_CASE("pressed surfaces stick, slip on Coulomb's cone, and stick again when the hand turns back") {
    Tool tool(0.5);
    CHECK(tool.to(-2, 0.3, 0) == doctest::Approx(0)); // 1 N in the gap
    CHECK(tool.p[1] == doctest::Approx(-0.3));
    CHECK(tool.to(-2, 0.8, 0) == doctest::Approx(0.5 * 0.3)); // slips by 0.3 mm under 0.5 N
    CHECK(tool.p[1] == doctest::Approx(-0.5));
    CHECK(tool.to(-2, 0.6, 0) == doctest::Approx(0));
    CHECK(tool.p[1] == doctest::Approx(-0.3));
    CHECK(tool.to(-2, -0.5, 0) == doctest::Approx(0.5 * 0.3)); // back by as much
    CHECK(tool.p[1] == doctest::Approx(0.5));
    CHECK(tool.to(0, -0.5, 0) == doctest::Approx(0));
    CHECK(tool.p[1] == 0);
    CHECK(tool.to(-2, -0.5, 0) == doctest::Approx(0)); // it sticks where it has come down
    CHECK(std::abs(tool.p[1]) < 1e-6);
}

TEST_CASE("friction opposes the slip, whatever its direction") {
    Tool tool(0.5);
    tool.to(-2, 0, 0);
    tool.to(-2, 3, -4);
    CHECK(tool.p[1] == doctest::Approx(-0.3));
    CHECK(tool.p[2] == doctest::Approx(0.4));
    CHECK(tool.to(-2, 3, -4) == doctest::Approx(0));
}
