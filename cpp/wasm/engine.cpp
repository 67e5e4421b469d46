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

constexpr double no_area = 1e-9; // of all cuts: less is rounding

enum Cut : int { nothing_met = 4 }; // beside what `Made` says

struct Organ {
    OrganSolid solid;
    std::vector<std::vector<BladeTriangle>> cuts;
    std::vector<BladeTriangle> blade;         // of the next cut
    std::unique_ptr<OrganBody> whole, opened; // before all cuts, if it came so, and with them
    std::unique_ptr<Simulation> simulation;
    Commands commands;
    bool by_clock = true;
    std::vector<float> moved, drawn; // mm, displacements of shown nodes, and of what is drawn
    const OrganBody& body() const { return opened ? *opened : *whole; }
} organ;

template <class T> void take(std::vector<T>& to, const T* from, size_t count) { to.assign(from, from + count); }

std::vector<BladeTriangle> triangles_at(int count, const double* corners) {
    std::vector<BladeTriangle> out;
    for (int t = 0; t < count; t++, corners += 9) out.emplace_back(corners, corners + 3, corners + 6);
    return out;
}

// A body takes over; none: the one before all cuts.
void change_body(std::unique_ptr<OrganBody> to) {
    const OrganBody& next = to ? *to : *organ.whole;
    auto state = next.model->make_state();
    if (organ.by_clock) next.model->begin_realtime(*state);
    organ.simulation->change(
        {next.model.get(), std::move(state), 1, next.surface.get(), next.surface->scratch(), next.shown});
    {
        ActiveModel before = organ.simulation->retired();
        if (organ.by_clock) before.model->end_realtime(*before.state);
    }
    organ.opened = std::move(to);
}

// The body with these cuts, if it can be made.
int change_cuts(std::vector<std::vector<BladeTriangle>> cuts) {
    std::unique_ptr<OrganBody> to;
    Made answer = made;
    if (!cuts.empty()) to = std::make_unique<OrganBody>(cut_body_of(organ.solid, cuts, answer));
    if (answer != made) return answer;
    if (cuts.size() > organ.cuts.size() && to->area - organ.body().area <= no_area * to->area) return nothing_met;
    change_body(std::move(to));
    organ.cuts = std::move(cuts);
    return made;
}

} // namespace

#define EXPORTED extern "C" __attribute__((visibility("default")))

EXPORTED void* allocate(size_t bytes) { return ::operator new(bytes); }
EXPORTED void release(void* memory) { ::operator delete(memory); }

// node: (nodes, 3) mm; tet: (tets, 4); region, lam, mu: (tets); fixed: (nodes); triangle: (triangles, 3) of the outer
// surface; shown: (count) ascending; labels: the largest region first; blade: (.., 3, 3), the triangles of
// the cuts that the organ comes with, cut_size of each. Lengths in mm, forces in N, toughness in J/m^2.
EXPORTED int make(int nodes, const double* node, int tets, const int32_t* tet, const int32_t* region, const double* lam,
                  const double* mu, const uint8_t* fixed, int triangles, const int32_t* triangle, int count,
                  const int32_t* shown, int regions, const int32_t* labels, int cut_count, const int32_t* cut_size,
                  const double* blade, double edge, double radius, double limit, double friction, double toughness) {
    OrganSolid& solid = organ.solid;
    take(solid.node, node, 3 * size_t(nodes)), take(solid.fixed, fixed, nodes);
    take(solid.tet, tet, 4 * size_t(tets)), take(solid.region, region, tets);
    take(solid.lam, lam, tets), take(solid.mu, mu, tets);
    take(solid.triangle, triangle, 3 * size_t(triangles)), take(solid.regions, labels, regions);
    solid.shown.assign(shown, shown + count);
    solid.edge = edge;
    organ.whole.reset(), organ.opened.reset();
    organ.cuts = {};
    for (int k = 0; k < cut_count; blade += 9 * size_t(cut_size[k++]))
        organ.cuts.push_back(triangles_at(cut_size[k], blade));
    if (cut_count > 0) {
        Made answer = made;
        organ.opened = std::make_unique<OrganBody>(cut_body_of(solid, organ.cuts, answer));
        if (answer != made) return answer;
    } else {
        organ.whole = std::make_unique<OrganBody>(whole_body(solid));
        if (!organ.whole->model) return not_positive_definite;
    }
    SimulationSettings settings;
    settings.sweeps = 1;
    settings.limit = limit;
    settings.tools.radius = radius;
    settings.tools.friction = friction;
    settings.tools.blade.toughness = toughness;
    organ.simulation = std::make_unique<Simulation>(*organ.body().model, *organ.body().surface, settings);
    organ.simulation->follow_clock(true);
    return made;
}

// The blade of a cut along a way on the surface at rest, (points, 3) mm, `depth` mm deep in the direction (x, y, z), or
// against the surface if that is 0. Returns how many triangles it has, 0 if the surface's normals give it no way;
// blade_corners() gives those, (.., 3, 3) mm.
EXPORTED int incise(int points, const double* point, double depth, double x, double y, double z) {
    std::vector<Point3> path(points);
    for (int k = 0; k < points; k++) std::copy_n(point + 3 * size_t(k), 3, path[k].begin());
    const double edge = organ.solid.edge;
    const double given[3] = {x, y, z};
    const double* direction = x == 0 && y == 0 && z == 0 ? nullptr : given;
    organ.blade = incision(*organ.body().surface, path, incision_step * edge, edge, direction).swept(depth + edge);
    return int(organ.blade.size());
}

EXPORTED void blade_corners(double* out) {
    for (const BladeTriangle& triangle : organ.blade)
        for (const Point3& x : triangle.corner) out = std::copy(x.begin(), x.end(), out);
}

// Cuts by the triangles of a blade, (triangles, 3, 3) mm.
EXPORTED int cut(int triangles, const double* corners) {
    auto cuts = organ.cuts;
    cuts.push_back(triangles_at(triangles, corners));
    return change_cuts(std::move(cuts));
}

// Takes the last cut back. The organ has one.
EXPORTED int undo() {
    auto cuts = organ.cuts;
    cuts.pop_back();
    return change_cuts(std::move(cuts));
}

// What is drawn of a body that was cut. out: numbers of vertices, triangles and regions, mm^2 of all cuts; then where
// these are: vertices (.., 3) mm as float32, triangles (.., 3), the first vertex on lips of each region, the volumes of
// each that came free, mm^3.
EXPORTED void opened(double* out) {
    const OrganBody& body = *organ.opened;
    *out++ = double(body.drawn.vertex.size()), *out++ = double(body.drawn.triangle.size());
    *out++ = double(body.drawn.lips.size()), *out++ = body.area;
    for (const void* at : {(const void*)body.rest.data(), (const void*)body.drawn.triangle.data(),
                           (const void*)body.drawn.lips.data(), (const void*)body.taken.data()})
        *out++ = double(reinterpret_cast<size_t>(at));
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
EXPORTED void follow_clock(int on) {
    organ.by_clock = on != 0;
    organ.simulation->follow_clock(organ.by_clock);
}

// Some ms of work on tables for where the tools are going, and on the displayed field. Returns 0 if there was none.
EXPORTED int prepare() {
    organ.simulation->look_ahead(organ.commands);
    const auto& state = static_cast<const ComplianceState&>(organ.simulation->state());
    return state.samples[0]->precompute->work();
}

// The state as numbers: tick, faults, serial, work (N mm), then for each tool its contact, and the points,
// displacements and forces of all, and their insertions. Returns the displacement of what is drawn, mm.
EXPORTED const float* frame(double* out) {
    Simulation& now = *organ.simulation;
    *out++ = double(now.ticks), *out++ = double(now.faults), *out++ = double(organ.commands.serial), *out++ = now.work;
    for (const ToolProxy& tool : now.proxy) *out++ = int(tool.state);
    for (const ToolProxy& tool : now.proxy) out = std::copy_n(tool.at.point, 3, out);
    for (const ToolProxy& tool : now.proxy) out = std::copy_n(tool.displacement, 3, out);
    for (const ToolProxy& tool : now.proxy) tool.total_force(out), out += 3;
    for (const ToolProxy& tool : now.proxy) *out++ = tool.insertion;
    const std::vector<int>& shown = organ.body().shown;
    organ.moved.resize(3 * shown.size());
    now.displayed_displacement(shown.data(), int(shown.size()), organ.moved.data());
    return organ.body().carried(organ.moved, organ.drawn);
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
