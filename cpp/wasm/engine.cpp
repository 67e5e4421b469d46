// The touch engine in a browser: a C interface for web/src/engine. One organ, one thread: who calls step() by the clock
// calls prepare() between. In a worker of its own the same module makes cut bodies: take_organ(), then build() for
// each; their arrays go to the module that runs the session, which adopts them. Memory is the caller's: it asks for it
// by allocate() and fills it.
#include "cutting/incision.h"
#include "simulation/simulation.h"
#include "wasm/organ_body.h"
#include <algorithm>
#include <memory>

using namespace palpate;

namespace {

constexpr double no_area = 1e-9; // of all cuts: less is rounding

enum Refused : int { nothing_met = 4 };                  // beside what `Made` says
enum Change : int { cut_once, cut_further, cut_undone }; // further: the blade takes the place of the last one

struct Organ {
    OrganSolid solid;
    SimulationSettings settings;
    Cuts cuts;
    std::vector<BladeTriangle> blade;             // of the next cut
    BodyArrays arrays;                            // of the next body
    std::unique_ptr<OrganBody> whole, opened;     // before all cuts, if it came so, and with them
    std::shared_ptr<const ContactSurface> stroke; // that the blade has entered
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

Cuts cuts_at(int count, const int32_t* size, const double* corners) {
    Cuts out;
    for (int k = 0; k < count; corners += 9 * size_t(size[k++])) out.push_back(triangles_at(size[k], corners));
    return out;
}

// A body takes over; none: the one before all cuts.
void change_body(std::unique_ptr<OrganBody> to) {
    const OrganBody& next = to ? *to : *organ.whole;
    auto state = next.model->make_state();
    if (organ.by_clock) next.model->begin_realtime(*state);
    organ.simulation->change(
        {next.model.get(), std::move(state), 1, next.surface.get(), next.surface->scratch(), next.arrays.shown});
    {
        ActiveModel before = organ.simulation->retired();
        if (organ.by_clock) before.model->end_realtime(*before.state);
    }
    organ.opened = std::move(to);
}

// The cuts that there are once they have changed.
Cuts changed(Change how, int triangles, const double* corners) {
    Cuts out = organ.cuts;
    if (how != cut_once) out.pop_back();
    if (how != cut_undone) out.push_back(triangles_at(triangles, corners));
    return out;
}

// The body of `arrays` takes over, which has these cuts.
int adopt(Change how, Cuts cuts) {
    auto to = std::make_unique<OrganBody>(std::move(organ.arrays));
    organ.arrays = {};
    if (how == cut_once && to->area - organ.body().area <= no_area * to->area) return nothing_met;
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
// the cuts that the organ comes with, cut_size of each; toughness: (regions) J/m^2. Lengths in mm, forces in N.
EXPORTED void take_organ(int nodes, const double* node, int tets, const int32_t* tet, const int32_t* region,
                         const double* lam, const double* mu, const uint8_t* fixed, int triangles,
                         const int32_t* triangle, int count, const int32_t* shown, int regions, const int32_t* labels,
                         int cut_count, const int32_t* cut_size, const double* blade, double edge, double radius,
                         double limit, double friction, const double* toughness) {
    OrganSolid& solid = organ.solid;
    take(solid.node, node, 3 * size_t(nodes)), take(solid.fixed, fixed, nodes);
    take(solid.tet, tet, 4 * size_t(tets)), take(solid.region, region, tets);
    take(solid.lam, lam, tets), take(solid.mu, mu, tets);
    take(solid.triangle, triangle, 3 * size_t(triangles)), take(solid.regions, labels, regions);
    solid.shown.assign(shown, shown + count);
    solid.edge = edge;
    organ.cuts = cuts_at(cut_count, cut_size, blade);
    SimulationSettings& settings = organ.settings;
    settings.sweeps = 1;
    settings.limit = limit;
    settings.tools.radius = radius;
    settings.tools.friction = friction;
    settings.tools.blade.tissue = std::make_shared<CutResistance>(node, tet, region, tets, labels, toughness, regions);
}

// Makes the body of the organ with these cuts, beside those that it comes with, as arrays. blade: as in take_organ().
EXPORTED int build(int cut_count, const int32_t* cut_size, const double* blade) {
    Cuts cuts = organ.cuts;
    for (auto& more : cuts_at(cut_count, cut_size, blade)) cuts.push_back(std::move(more));
    return make_body(organ.solid, cuts, organ.arrays);
}

// Where these arrays are, and how many bytes each has. Returns how many there are.
EXPORTED int arrays_at(double* out) {
    const std::vector<AnyArray> arrays = arrays_of(organ.arrays);
    for (const AnyArray& one : arrays) *out++ = double(reinterpret_cast<size_t>(one.data)), *out++ = double(one.bytes);
    return int(arrays.size());
}

// Room for one of them, which another memory has made.
EXPORTED void* room_for(int which, double bytes) {
    const AnyArray one = arrays_of(organ.arrays)[which];
    return one.resized(one.vector, size_t(bytes));
}

// Makes the organ that was taken, with the cuts that it comes with, and begins its session.
EXPORTED int begin() {
    organ.whole.reset(), organ.opened.reset();
    const Made answer = make_body(organ.solid, organ.cuts, organ.arrays);
    if (answer != made) return answer;
    auto body = std::make_unique<OrganBody>(std::move(organ.arrays));
    organ.arrays = {};
    organ.simulation = std::make_unique<Simulation>(*body->model, *body->surface, organ.settings);
    organ.simulation->follow_clock(true);
    (organ.cuts.empty() ? organ.whole : organ.opened) = std::move(body);
    return made;
}

// A blade enters: all of its way follows the surface as it is now.
EXPORTED void enter() { organ.stroke = organ.body().surface; }

// The blade of a cut along a way on that surface at rest, (points, 3) mm, `depth` mm deep in the direction (x, y, z),
// or against the surface if that is 0. way: (3) unit, from there into the tissue. Returns how many triangles it has, 0
// if the surface's normals give it no way; blade_corners() gives those, (.., 3, 3) mm.
EXPORTED int incise(int points, const double* point, double depth, double x, double y, double z, double* way) {
    std::vector<Point3> path(points);
    for (int k = 0; k < points; k++) std::copy_n(point + 3 * size_t(k), 3, path[k].begin());
    const double edge = organ.solid.edge;
    const double given[3] = {x, y, z};
    const double* direction = x == 0 && y == 0 && z == 0 ? nullptr : given;
    const Incision made = incision(*organ.stroke, path, incision_step * edge, edge, direction);
    std::copy_n(made.way.begin(), 3, way);
    organ.blade = made.swept(depth + edge);
    return int(organ.blade.size());
}

EXPORTED void blade_corners(double* out) {
    for (const BladeTriangle& triangle : organ.blade)
        for (const Point3& x : triangle.corner) out = std::copy(x.begin(), x.end(), out);
}

// The body whose arrays have come takes over. how: cuts once more by the triangles of a blade, (triangles, 3, 3) mm, or
// further than the last time, or takes the last cut back.
EXPORTED int adopt_body(int how, int triangles, const double* corners) {
    return adopt(Change(how), changed(Change(how), triangles, corners));
}

// Changes the body in the same way, making it here.
EXPORTED int change(int how, int triangles, const double* corners) {
    Cuts cuts = changed(Change(how), triangles, corners);
    if (cuts.empty() && organ.whole) {
        change_body(nullptr);
        organ.cuts = {};
        return made;
    }
    const Made answer = make_body(organ.solid, cuts, organ.arrays);
    return answer == made ? adopt(Change(how), std::move(cuts)) : answer;
}

// What is drawn of a body that was cut. out: numbers of vertices, triangles and regions, mm^2 of all cuts; then where
// these are: vertices (.., 3) mm as float32, triangles (.., 3), the first vertex on lips of each region, the volumes of
// each that came free, mm^3.
EXPORTED void opened(double* out) {
    const OrganBody& body = *organ.opened;
    const DrawnSkin& drawn = body.arrays.drawn;
    *out++ = double(drawn.vertex.size()), *out++ = double(drawn.triangle.size());
    *out++ = double(drawn.lips.size()), *out++ = body.area;
    for (const void* at : {(const void*)body.arrays.rest.data(), (const void*)drawn.triangle.data(),
                           (const void*)drawn.lips.data(), (const void*)body.arrays.taken.data()})
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
    const std::vector<int>& shown = organ.body().arrays.shown;
    organ.moved.resize(3 * shown.size());
    now.displayed_displacement(shown.data(), int(shown.size()), organ.moved.data());
    return organ.body().drawn(organ.moved, organ.drawn);
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
