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
    double weight[Patch::capacity];   // of all patches together, sum 1
    double load[3 * Patch::capacity]; // on the tissue, N
    void copy(const Touch& other);    // no more than it holds
};

class Ahead;

// Forces and what they follow from. The stiffness S = C^-1 of the patches, C_ab = sum w_ai w_bj G_ij, comes from blocks
// between their nodes. Where some are not made yet, the last stiffness serves; when they come, what it was off by fades
// out.
struct ComplianceState : State {
    ComplianceState(const Elastic& elastic, size_t budget);
    ~ComplianceState() override;
    // u is left to whoever solves for the whole body: a tick knows its patch only.
    std::vector<double>& memory() override { return kept; }

    // closed and open contacts (2); force on the tools, displacement (3 a tool each); stiffness in use, what it is off
    // by (of all closed tools' 3 by all, each); 1: it was exact up to that, -1: it was not (1)
    std::vector<double> kept;
    Green green;
    Latest<Touch> touches; // written by ticks
    Touch touch;
    int64_t cold_ticks = 0;

    // The patches' nodes together by rising vertex, and the blocks of each pair a >= b at a (a + 1) / 2 + b, closely
    // packed: a tick that finds the caches cold reads little.
    struct Pairs {
        int count = 0;
        std::vector<int> vertex;    // (capacity)
        std::vector<float> block;   // (pairs, 9)
        std::vector<uint8_t> known; // (pairs)
        int lacking = 0;            // pairs that are not known
        int64_t looked = -1;        // how many tables had been made when they were last looked for
        bool of(const int* others, int many) const {
            return many == count && std::equal(others, others + many, vertex.begin());
        }
    } pairs, spare;             // spare: those before, or those expected next
    std::vector<double> weight; // (tools, capacity) of each patch's nodes, in the order of `pairs`
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
    bool advance(State& state, const Patch* patches, int closed, int open, double* displacement, int sweeps,
                 double* force) const override;
    void show(State& state, const int* nodes, int count, float* out) const override;
    void displacement(State& state, double* out) const override;
    void expect(State& state, const Patch* patches, int count) const override;
    void accompany(State& state) const override;
    void leave(State& state) const override;

    // The vertices' displacement (vertices, 3) mm from columns, where each of the patch has its own; else false.
    static bool contract(const Green& green, const Touch& touch, int vertices, float* out);

    const Elastic elastic;

private:
    const size_t budget;
    void take_count(ComplianceState& s, int closed) const;
    void let_go(ComplianceState& s) const;
    bool seat(ComplianceState& s, const Patch* patches, int count) const;
    void fetch(Green& green, ComplianceState::Pairs& pairs) const;
    void make_now(ComplianceState& s) const;
    bool take_stiffness(ComplianceState& s, int closed, const double* displacement) const;
    void answer(ComplianceState& s, int closed, const double* displacement, double* force) const;
    void feel_others(ComplianceState& s, int closed, int open, double* displacement, double* force) const;
};

} // namespace palpate
