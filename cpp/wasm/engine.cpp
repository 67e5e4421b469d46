// The touch engine in a browser: a C interface for web/src/engine. One organ, one thread: who calls step() by the clock
// calls prepare() between.
// Memory is the caller's: it asks for it by allocate() and fills it before make() or cut().
#include "cutting/incision.h"
#include "simulation/simulation.h"
#include "wasm/organ_body.h"
#include <algorithm>
#include <memory>

using namespace palpate;

namespace {

enum Made : int { made = 0, not_positive_definite = 1, piece_comes_free = 2, no_way = 3, nothing_met = 4 };

struct Organ {
    OrganSolid solid;
    std::vector<std::vector<BladeTriangle>> cuts;
    std::unique_ptr<OrganBody> whole, present, next; // the uncut one, one that was cut, one from the next tick on
    std::unique_ptr<Simulation> simulation;
    Commands commands;
    std::vector<float> moved, drawn; // mm, displacements of shown nodes, and of what is drawn
    const OrganBody& body() const { return present ? *present : *whole; }
} organ;

template <class T> void take(std::vector<T>& to, const T* from, size_t count) { to.assign(from, from + count); }

// The body of all cuts so far takes over from the next tick on.
Made change_body() {
    std::vector<BladeTriangle> blades;
    for (const auto& cut : organ.cuts) blades.insert(blades.end(), cut.begin(), cut.end());
    OrganBody* to = organ.whole.get();
    organ.next.reset();
    if (!blades.empty()) {
        bool comes_free = false;
        organ.next = std::make_unique<OrganBody>(cut_body_of(organ.solid, blades, comes_free));
        to = organ.next.get();
        if (comes_free) return piece_comes_free;
        if (!to->model) return not_positive_definite;
    }
    organ.simulation->change(
        {to->model.get(), to->model->make_state(), 1, to->surface.get(), to->surface->scratch(), to->shown});
    return made;
}

} // namespace

#define EXPORTED extern "C" __attribute__((visibility("default")))

EXPORTED void* allocate(size_t bytes) { return ::operator new(bytes); }
EXPORTED void release(void* memory) { ::operator delete(memory); }

// node: (nodes, 3) mm; tet: (tets, 4); region, lam, mu: (tets); fixed: (nodes); triangle: (triangles, 3) of the outer
// surface; shown: (count) ascending; labels: the largest region first; lengths in mm, forces in N, toughness in J/m^2.
EXPORTED int make(int nodes, const double* node, int tets, const int32_t* tet, const int32_t* region, const double* lam,
                  const double* mu, const uint8_t* fixed, int triangles, const int32_t* triangle, int count,
                  const int32_t* shown, int regions, const int32_t* labels, double edge, double radius, double limit,
                  double friction, double toughness) {
    OrganSolid& solid = organ.solid;
    take(solid.node, node, 3 * size_t(nodes)), take(solid.fixed, fixed, nodes);
    take(solid.tet, tet, 4 * size_t(tets)), take(solid.region, region, tets);
    take(solid.lam, lam, tets), take(solid.mu, mu, tets);
    take(solid.triangle, triangle, 3 * size_t(triangles)), take(solid.regions, labels, regions);
    solid.shown.assign(shown, shown + count);
    solid.edge = edge;
    organ.whole = std::make_unique<OrganBody>(whole_body(solid));
    if (!organ.whole->model) return not_positive_definite;
    SimulationSettings settings;
    settings.sweeps = 1;
    settings.limit = limit;
    settings.tools.radius = radius;
    settings.tools.friction = friction;
    settings.tools.blade.toughness = toughness;
    organ.simulation = std::make_unique<Simulation>(*organ.whole->model, *organ.whole->surface, settings);
    organ.simulation->follow_clock(true);
    return made;
}

// Cuts along a way on the surface of the organ as it is, (points, 3) mm, `depth` mm deep.
EXPORTED int cut(int points, const double* point, double depth) {
    std::vector<Point3> path(points);
    for (int k = 0; k < points; k++) std::copy_n(point + 3 * size_t(k), 3, path[k].begin());
    const double edge = organ.solid.edge;
    const Incision way = incision(*organ.body().surface, path, incision_step * edge, edge, nullptr);
    if (way.upper.empty()) return no_way;
    const double before = organ.body().area;
    organ.cuts.push_back(way.swept(depth + edge));
    Made answer = change_body();
    if (answer == made && organ.next->area == before) answer = nothing_met;
    if (answer != made) organ.cuts.pop_back(), organ.next.reset();
    return answer;
}

// Takes the last cut back. The organ has one.
EXPORTED int undo() {
    organ.cuts.pop_back();
    return change_body();
}

// Of the body that was cut last: numbers of drawn vertices, triangles and regions, area (mm^2) of all cuts, and where
// these lie: vertices (.., 3) mm as float32, triangles (.., 3), the first vertex on lips of each region, the blades'
// triangles (.., 3, 3) mm as float64, and how many of those each cut has.
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
