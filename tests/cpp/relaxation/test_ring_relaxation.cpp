#include "relaxation/ring_relaxation.h"
#include <doctest.h>

using namespace palpate;

TEST_CASE("rings are the breadth-first distance from the contact, unreached nodes come last") {
    const int width = 9, height = 7, nodes = width * height + 2; // a grid, and two nodes of their own
    SparsityPattern graph;
    for (int i = 0; i < nodes; i++) {
        for (int j = 0; j < width * height && i < width * height; j++)
            if (std::abs(i / width - j / width) + std::abs(i % width - j % width) == 1) graph.column.push_back(j);
        graph.start.push_back(int(graph.column.size()));
    }
    BreadthFirstRings rings(nodes);
    const int contact[2] = {2 * width + 3, 5 * width + 7};
    rings.build(graph, contact, 2);
    int last = 0;
    for (int i = 0; i < width * height; i++) {
        int distance = 1000;
        for (int t : contact)
            distance = std::min(distance, std::abs(i / width - t / width) + std::abs(i % width - t % width));
        CHECK(rings.ring[i] == distance + 1);
        last = std::max(last, distance + 1);
    }
    CHECK(rings.ring[nodes - 1] == last + 1);
    CHECK(rings.ring_count == last + 1);
    for (int k = 1; k < nodes; k++) CHECK(rings.ring[rings.order[k - 1]] <= rings.ring[rings.order[k]]);
}
