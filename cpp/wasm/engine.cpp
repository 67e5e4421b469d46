// The touch engine in a browser: a C interface for web/src/engine. One organ, one thread: who calls step() by the clock
// calls prepare() between.
// Memory is the caller's: it asks for it by allocate() and fills it before make().
#include "compliance/compliance_model.h"
#include "elements/smoothed_stiffness.h"
#include "simulation/simulation.h"
#include <algorithm>
#include <iterator>
#include <memory>

using namespace palpate;

namespace {

constexpr size_t table_bytes = size_t(256) << 20; // of the compliance's tables, as in Python

enum Made : int { made = 0, not_positive_definite = 1 };

struct Organ { // in the order in which each refers to those before
    std::unique_ptr<SparseCholesky> factor;
    std::unique_ptr<ComplianceModel> model;
    std::unique_ptr<ContactSurface> surface;
    std::unique_ptr<Simulation> simulation;
    Commands commands;
    std::vector<int> shown_nodes;
    std::vector<float> shown; // mm, their displacements
} organ;

std::vector<int> numbered_free(const uint8_t* fixed, int nodes) {
    std::vector<int> out(nodes, -1);
    for (int i = 0, next = 0; i < nodes; i++)
        if (!fixed[i]) out[i] = next++;
    return out;
}

} // namespace

#define EXPORTED extern "C" __attribute__((visibility("default")))

EXPORTED void* allocate(size_t bytes) { return ::operator new(bytes); }
EXPORTED void release(void* memory) { ::operator delete(memory); }

// node: (nodes, 3) mm; tet: (tets, 4); region, lam, mu: (tets); fixed: (nodes); triangle: (triangles, 3) of the outer
// surface; shown: (count) ascending; lengths in mm, forces in N.
EXPORTED int make(int nodes, const double* node, int tets, const int32_t* tet, const int32_t* region, const double* lam,
                  const double* mu, const uint8_t* fixed, int triangles, const int32_t* triangle, int count,
                  const int32_t* shown, double radius, double limit, double friction) {
    const std::vector<int> free_index = numbered_free(fixed, nodes);
    std::vector<double> places;
    for (int i = 0; i < nodes; i++)
        if (free_index[i] >= 0) places.insert(places.end(), node + 3 * size_t(i), node + 3 * size_t(i) + 3);
    {
        const BlockCsr K = smoothed_stiffness({node, tet, region, lam, mu, nodes, tets}, free_index);
        organ.factor = std::make_unique<SparseCholesky>(K, places.data());
    }
    if (!organ.factor->positive) return not_positive_definite;
    std::vector<int> vertices;
    std::copy_if(shown, shown + count, std::back_inserter(vertices), [&](int i) { return free_index[i] >= 0; });
    organ.model =
        std::make_unique<ComplianceModel>(factored_stiffness(*organ.factor, free_index, vertices, node), table_bytes);
    organ.factor->value = {}; // ticks and tables take the rounded one
    organ.surface = std::make_unique<ContactSurface>(node, nodes, triangle, triangles, fixed);
    SimulationSettings settings;
    settings.sweeps = 1;
    settings.limit = limit;
    settings.tools.radius = radius;
    settings.tools.friction = friction;
    organ.simulation = std::make_unique<Simulation>(*organ.model, *organ.surface, settings);
    organ.simulation->follow_clock(true);
    organ.shown_nodes.assign(shown, shown + count);
    organ.shown.resize(3 * size_t(count));
    return made;
}

EXPORTED void command(int tool, int kind, double x, double y, double z, double u, double v, double w, double serial) {
    organ.commands.serial = int64_t(serial);
    organ.commands.tool[tool] = {CommandKind(kind), {x, y, z}, {u, v, w}};
}

// forces: (ticks, tools, 3) N.
EXPORTED void step(int ticks, double* forces) {
    for (int i = 0; i < ticks; i++) {
        organ.simulation->tick(organ.commands);
        for (int t = 0; t < most_tools; t++)
            organ.simulation->proxy[t].total_force(forces + 3 * (size_t(most_tools) * i + t));
    }
}

// 0: from now on a tick makes the tables that it lacks, so that its answer depends on nothing but the commands.
EXPORTED void follow_clock(int on) { organ.simulation->follow_clock(on != 0); }

// Some ms of work on tables for where the tools are going, and on the displayed field. Returns 0 if there was none.
EXPORTED int prepare() {
    organ.simulation->look_ahead(organ.commands);
    const auto& state = static_cast<const ComplianceState&>(organ.simulation->state());
    return state.samples[0]->precompute->work();
}

// The state as numbers: tick, faults, serial, work (N mm), then for each tool its contact, and the points,
// displacements and forces of all, and their insertions. Returns the displacement of the shown nodes, mm.
EXPORTED const float* frame(double* out) {
    Simulation& now = *organ.simulation;
    *out++ = double(now.ticks), *out++ = double(now.faults), *out++ = double(organ.commands.serial), *out++ = now.work;
    for (const ToolProxy& tool : now.proxy) *out++ = int(tool.state);
    for (const ToolProxy& tool : now.proxy) out = std::copy_n(tool.at.point, 3, out);
    for (const ToolProxy& tool : now.proxy) out = std::copy_n(tool.displacement, 3, out);
    for (const ToolProxy& tool : now.proxy) tool.total_force(out), out += 3;
    for (const ToolProxy& tool : now.proxy) *out++ = tool.insertion;
    now.displayed_displacement(organ.shown_nodes.data(), int(organ.shown_nodes.size()), organ.shown.data());
    return organ.shown.data();
}

// Of the last tick, as a recording keeps it: TableEvent::missing_tables.
EXPORTED int missing_tables() { return organ.simulation->missing_tables; }

// For a replay, not by the clock: the next tick lacks what the recorded one lacked.
EXPORTED void set_missing_tables(int recorded) {
    organ.simulation->set_missing_tables(recorded | TableEvent::recorded);
}

// Of state and forces, as two halves of 32 bits.
EXPORTED double digest_high() { return double(organ.simulation->digest() >> 32); }
EXPORTED double digest_low() { return double(organ.simulation->digest() & 0xffffffffu); }
