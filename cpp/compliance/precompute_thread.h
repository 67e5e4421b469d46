#pragma once
// The background thread of a ComplianceState. It fills GreensFunctions ahead of the tool; the loop's thread sends it
// snapshots and reads its display field, both through triple buffers.
#include "compliance/gap_constraints.h"
#include "compliance/load_history.h"
#include "compliance/vibration_modes.h"
#include "realtime/triple_buffer.h"
#include "tissue/contact_patch.h"
#include <chrono>
#include <thread>

namespace palpate {

// The contact as the last tick left it.
struct ContactSnapshot {
    static constexpr int capacity = LoadHistory::capacity;
    int64_t serial = 0; // ticks answered; 0: none yet
    int count = 0;      // vertices of the patches; 0: no contact
    int loads = 0;      // vertices with loads: those of the patches, then those that the tissue's history holds
    int vertex[capacity];
    double weight[ContactPatch::capacity]; // mean over the patches, sum 1
    double load[3 * capacity];             // on the tissue as an elastic one, N
    int modes = 0;
    float amplitude[VibrationModes::most]; // of the modes of vibration
    int gaps = 0;
    float gap_force[GapConstraints::most_rows] = {}; // N, in gaps that have closed; 0 beyond the last one
    void copy(const ContactSnapshot& other);         // copies only the entries in use
};

// Computes, in this order: the patch's own blocks, blocks along its predicted path, columns for the display while the
// tool is slow, blocks of the nearest other vertices. Publishes a display field about 30 times a second.
class PrecomputeThread {
public:
    PrecomputeThread(const FactoredStiffness& stiffness, GreensFunctions& greens, const VibrationModes& modes,
                     const GapConstraints& gaps, const std::atomic<bool>& looks_ahead,
                     TripleBuffer<ContactSnapshot>& snapshots);
    ~PrecomputeThread();
    // The next piece of work, of some ms. False: there was none. The thread calls it; where there are no threads
    // (wasm/), who runs the ticks does, between them.
    bool work();
    const float* newest_field() { return fields.latest().data(); } // (vertices, 3) mm; for one thread

private:
    const FactoredStiffness& stiffness;
    GreensFunctions& greens;
    const VibrationModes& modes;
    const GapConstraints& gaps;
    const std::atomic<bool>& looks_ahead; // also for what no hand is near to
    TripleBuffer<ContactSnapshot>& snapshots;
    TripleBuffer<std::vector<float>> fields;
    ContactSnapshot snapshot;
    double centre[3] = {0, 0, 0}, velocity[3] = {0, 0, 0}; // mm, mm per tick
    double patch_width = 0;                                // mm
    double reach = 0, needed_reach = 0;                    // mm, of the blocks computed, and of those a tick needs
    int64_t velocity_serial = 0, field_serial = 0;         // of the snapshots last used
    bool all_computed = false;                             // every vertex has its blocks
    std::vector<int> predicted, wanted;
    std::vector<std::pair<double, int>> candidates; // cost, vertex
    std::chrono::steady_clock::time_point next_field = std::chrono::steady_clock::now();
    std::atomic<bool> stopping{false};
    std::thread thread;
    void run();
    void read_snapshot();
    void predict_path();
    bool compute_wanted_blocks();
    bool compute_columns();
    bool compute_nearest_blocks();
    void publish_field();
};

} // namespace palpate
