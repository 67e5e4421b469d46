#include "compliance/precompute_thread.h"
#include "base/platform.h"
#include <algorithm>
#include <chrono>
#include <cmath>

namespace palpate {
namespace {

using clock = std::chrono::steady_clock;
constexpr auto display_period = std::chrono::milliseconds(33);
constexpr auto idle_wait = std::chrono::microseconds(200);
constexpr int horizon = 200;        // ticks that the path is predicted for
constexpr double slow_speed = 0.01; // mm per tick: below it columns are computed
#ifdef __wasm__
constexpr int batch = 2; // vertices at a time: ticks wait for it
#else
constexpr int batch = GreensFunctions::batch;
#endif
constexpr double reach_margin = 1.25; // reach of the blocks over the patch's width, which varies over the surface

} // namespace

PrecomputeThread::PrecomputeThread(const FactoredStiffness& stiffness, GreensFunctions& greens,
                                   const VibrationModes& modes, const GapConstraints& gaps,
                                   const std::atomic<bool>& looks_ahead, TripleBuffer<ContactSnapshot>& snapshots)
    : stiffness(stiffness), greens(greens), modes(modes), gaps(gaps), looks_ahead(looks_ahead), snapshots(snapshots),
      fields(std::vector<float>(3 * size_t(stiffness.vertices()), 0.0f)) {
    thread = std::thread([this] { run(); });
}

PrecomputeThread::~PrecomputeThread() {
    stopping = true;
    if (thread.joinable()) thread.join();
}

void ContactSnapshot::copy(const ContactSnapshot& other) {
    serial = other.serial, count = other.count, loads = other.loads;
    std::copy_n(other.vertex, loads, vertex);
    std::copy_n(other.weight, count, weight);
    std::copy_n(other.load, 3 * loads, load);
    modes = other.modes;
    std::copy_n(other.amplitude, modes, amplitude);
    gaps = other.gaps;
    std::copy_n(other.gap_force, gaps, gap_force);
}

void PrecomputeThread::run() {
    lower_thread_priority(); // below the loop's
    while (!stopping.load(std::memory_order_relaxed))
        if (!work()) std::this_thread::sleep_for(idle_wait);
}

bool PrecomputeThread::work() {
    read_snapshot();
    if (clock::now() >= next_field && snapshot.serial != field_serial) {
        publish_field();
        next_field = clock::now() + display_period;
    }
    if (snapshot.count > 0) {
        predict_path();
        if (compute_wanted_blocks()) return true;
        if (length(velocity) < slow_speed && compute_columns()) return true;
    }
    return looks_ahead && reach > 0 && compute_nearest_blocks();
}

// Takes the newest snapshot: the patch's centre, width and velocity.
void PrecomputeThread::read_snapshot() {
    if (!snapshots.has_new()) return;
    const bool in_contact = snapshot.count > 0;
    snapshot.copy(snapshots.latest());
    if (snapshot.count == 0) {
        std::fill_n(velocity, 3, 0.0);
        return;
    }
    double now[3] = {0, 0, 0};
    for (int k = 0; k < snapshot.count; k++)
        for (int c = 0; c < 3; c++)
            now[c] += snapshot.weight[k] * stiffness.position[3 * size_t(snapshot.vertex[k]) + c];
    patch_width = 0;
    for (int i = 0; i < snapshot.count; i++)
        for (int j = 0; j < i; j++)
            patch_width = std::max(patch_width, stiffness.distance(snapshot.vertex[i], snapshot.vertex[j]));
    double furthest = 0;
    for (int k = snapshot.count; k < snapshot.loads; k++)
        furthest = std::max(furthest, distance(&stiffness.position[3 * size_t(snapshot.vertex[k])], now));
    needed_reach = reach_margin * (patch_width + furthest);
    if (needed_reach > reach) reach = reach_margin * needed_reach, all_computed = false;
    const int64_t ticks = snapshot.serial - velocity_serial;
    if (!in_contact || ticks >= 5) {
        for (int c = 0; c < 3; c++) {
            velocity[c] = in_contact ? 0.5 * velocity[c] + 0.5 * (now[c] - centre[c]) / double(ticks) : 0;
            centre[c] = now[c];
        }
        velocity_serial = snapshot.serial;
    }
}

// Vertices that the patch may reach, sorted by cost: their distance times 1 in the direction of motion, 2 across it and
// 3 against it, since the tool may turn. For a tool at rest, those within the patch's width.
void PrecomputeThread::predict_path() {
    predicted.clear();
    candidates.clear();
    const double tool_speed = length(velocity), scale = tool_speed > 0 ? 1 / tool_speed : 0;
    for (int v = 0; v < stiffness.vertices(); v++) {
        const double* at = &stiffness.position[3 * size_t(v)];
        double along = 0;
        for (int c = 0; c < 3; c++) along += (at[c] - centre[c]) * velocity[c] * scale;
        const double cost = 2 * distance(at, centre) - along;
        if (cost <= tool_speed * horizon + 2 * patch_width) candidates.push_back({cost, v});
    }
    std::sort(candidates.begin(), candidates.end());
    for (const auto& [cost, v] : candidates) predicted.push_back(v);
}

// Blocks of the first vertices that have none: the patch's own, those that have loads, those on the predicted path.
bool PrecomputeThread::compute_wanted_blocks() {
    wanted.assign(snapshot.vertex, snapshot.vertex + snapshot.loads);
    wanted.insert(wanted.end(), predicted.begin(), predicted.end());
    int missing[batch], count = 0;
    for (int v : wanted) {
        if (greens.has_blocks(v, needed_reach) || std::find(missing, missing + count, v) < missing + count) continue;
        missing[count++] = v;
        if (count == batch) break;
    }
    if (count == 0) return false;
    greens.mark_used(wanted.data(), int(wanted.size()));
    greens.compute_blocks(missing, count, reach);
    return true;
}

bool PrecomputeThread::compute_columns() {
    int missing[2], count = 0;
    for (int k = 0; k < snapshot.loads && count < 2; k++)
        if (!greens.columns(snapshot.vertex[k])) missing[count++] = snapshot.vertex[k];
    if (count == 0 || greens.columns_exceed_budget(snapshot.loads)) return false;
    greens.mark_used(snapshot.vertex, snapshot.loads);
    greens.compute_columns(missing, count);
    return true;
}

// Blocks of the vertices nearest to the patch, or to where it last was.
bool PrecomputeThread::compute_nearest_blocks() {
    if (all_computed || !greens.has_room()) return false;
    candidates.clear();
    for (int v = 0; v < stiffness.vertices(); v++) {
        if (greens.has_blocks(v, reach)) continue;
        candidates.push_back({square_of_distance(&stiffness.position[3 * size_t(v)], centre), v});
    }
    all_computed = candidates.empty();
    if (all_computed) return false;
    const int count = int(std::min<size_t>(batch, candidates.size()));
    std::partial_sort(candidates.begin(), candidates.begin() + count, candidates.end());
    int missing[batch];
    for (int k = 0; k < count; k++) missing[k] = candidates[k].second;
    greens.compute_blocks(missing, count, reach);
    return true;
}

void PrecomputeThread::publish_field() {
    float* out = fields.write_slot().data();
    if (snapshot.loads == 0)
        std::fill_n(out, 3 * size_t(stiffness.vertices()), 0.0f);
    else if (!greens.superpose(snapshot.vertex, snapshot.loads, snapshot.load, out))
        greens.solve(snapshot.vertex, snapshot.loads, snapshot.load, out);
    for (int v = 0; snapshot.modes > 0 && v < stiffness.vertices(); v++)
        modes.add_displacement(stiffness.vertex_node[v], snapshot.amplitude, out + 3 * size_t(v));
    if (snapshot.gaps > 0) gaps.add_displacement(snapshot.gap_force, out);
    fields.publish();
    field_serial = snapshot.serial;
}

} // namespace palpate
