#pragma once
#include "green.h"
#include "latest.h"
#include "model.h"

namespace palpate {

// The patch as the ticks last saw it, for whoever builds ahead of it, and for displays.
struct Touch {
    int64_t serial = 0; // ticks answered; 0: nothing was touched yet
    int count = 0;      // 0: let go
    int vertex[Patch::capacity];
    double weight[Patch::capacity];
    double force[3] = {0, 0, 0};   // on the tissue, N
    void copy(const Touch& other); // no more than it holds
};

class Ahead;

// A force and what it follows from. The stiffness S = C^-1 of the patch, C = sum w_i w_j G_ij, comes from blocks
// between its nodes. Where some are not made yet, the last stiffness serves; when they come, what it was off by fades
// out.
struct ComplianceState : State {
    ComplianceState(const Elastic& elastic, size_t budget);
    ~ComplianceState() override;
    // u is left to whoever solves for the whole body: a tick knows its patch only.
    std::vector<double>& memory() override { return kept; }

    // force (3) on the tool, displacement (3), stiffness in use (9), what it is off by (9), 1: it was exact up to that,
    // -1: it was not (1)
    std::vector<double> kept;
    Green green;
    Latest<Touch> touches; // written by ticks
    Touch touch;
    int64_t cold_ticks = 0;

    // The patch's nodes by rising vertex, and the blocks of each pair a >= b at a (a + 1) / 2 + b, closely packed: a
    // tick that finds the caches cold reads little.
    struct Pairs {
        int count = 0;
        std::vector<int> vertex;    // (capacity)
        std::vector<float> block;   // (pairs, 9)
        std::vector<uint8_t> known; // (pairs)
    } pairs, before;
    std::vector<double> weight; // (capacity) of the patch's nodes, in the order of `pairs`
    int lacking = 0;            // pairs that are not known
    int64_t looked = 0;         // how many tables had been made when they were last looked for
    bool moved = false;         // the patch has other nodes since
    std::vector<float> field;   // (vertices, 3) of the last display
    std::unique_ptr<Ahead> ahead;
};

// Exact linear finite elements by tables of their Green's functions, whatever the number of nodes: a tick costs the
// square of the patch's nodes. The body has no inertia, so what is not touched is at rest.
class Compliance : public Model {
public:
    Compliance(Elastic elastic, size_t budget); // bytes of tables, a state
    int nodes() const override { return elastic.nodes(); }
    std::unique_ptr<State> start() const override;
    void advance(State& state, const Patch* patch, const double displacement[3], int sweeps,
                 double force[3]) const override;
    void show(State& state, const int* nodes, int count, float* out) const override;
    void displacement(State& state, double* out) const override;
    void accompany(State& state) const override;
    void leave(State& state) const override;

    // The vertices' displacement (vertices, 3) mm from columns, where each of the patch has its own; else false.
    static bool contract(const Green& green, const Touch& touch, int vertices, float* out);

    const Elastic elastic;

private:
    const size_t budget;
    void seat(ComplianceState& s, const Patch& patch) const;
    void fetch(ComplianceState& s) const;
    void make_now(ComplianceState& s) const;
    void take_stiffness(ComplianceState& s, const double displacement[3]) const;
    void answer(ComplianceState& s, const double displacement[3], double force[3]) const;
};

} // namespace palpate
