#pragma once
// What a body remembers of the loads on it. ComplianceModel uses it in the loop's thread.
#include "compliance/load_recursion.h"
#include "compliance/patch_blocks.h"

namespace palpate {

// If the whole stiffness relaxes alike, the displacement is u = G p at any time, where the elastic loads p differ from
// zero at nodes that have been touched, until they have decayed there. Each such node keeps p and the forces h_k of the
// branches, whose sum p + sum h_k is the force on it: that of the tools, or zero. So a dent lasts after the tool has
// left, and another tool finds it. G p and G h_k are followed at the vertices of the contact alone. What lags behind
// its loads, and a body whose parts relax differently, obey other recursions of the same kind.
class LoadHistory {
public:
    static constexpr int capacity = 1024; // nodes; if they are more, the least is added to its nearest
    static constexpr int max_fields = LoadRecursion::max_fields;

    LoadHistory(const FactoredStiffness& stiffness, const LoadRecursion& recursion);

    // --- a tick, in this order
    // The contact's vertices, ascending: true if all their displacements due to the history are known. The blocks that
    // this needs are read if `may_read`. greens: (samples).
    bool enter(GreensFunctions* const* greens, const int* vertices, int count, bool may_read);
    // The displacement, mm, of the contact's vertex i if no force acted at the end of this tick.
    void free_displacement(int i, double out[3]) const;
    // A tick with these loads f (contact's vertices, 3) N on the tissue and the displacements G_s f (samples, contact's
    // vertices, 3) mm. If those are not known but guessed, the next enter() that finds the blocks mends the vertices'
    // displacements.
    void advance(const double* load, const double* elastic, bool known);
    // The displacement of the contact's vertex i as it is now: after advance(), at the end of the tick.
    void displacement(int i, double out[3]) const;
    double energy() const; // N mm, of all springs: what could be regained

    // --- for a display, and to compute tables
    int size() const { return int(node.size()); }
    int vertex(int k) const { return node[k].vertex; }
    int slot_of(int vertex) const { return slot[vertex]; }
    bool touched(int k) const; // by the contact
    // N: the displacement is the sum over the samples of G_s times these loads.
    void acting_load(int k, int sample, double out[3]) const;

    void reset();
    // All numbers that later answers depend on, appended.
    void append_to(std::vector<double>& numbers) const;
    size_t most_numbers() const;

    const LoadRecursion recursion;

private:
    struct Node { // of the history: the fields x_k, N; of the contact: C_k x_k, mm
        int vertex = -1;
        bool known = true;
        double value[max_fields][3] = {};
        double direct[3] =
            {}; // of the history: the force of the last tick; of the contact: what it moves without delay
    };
    const FactoredStiffness& stiffness;
    std::vector<Node> node, contact, entering;
    std::vector<int> slot;                       // (vertices) place in `node`, or -1
    double peak = 0;                             // N, the largest load of a node yet
    double product[max_fields][max_fields] = {}; // of the fields j, k: x_j' C_k x_k, N mm
    double direct_product = 0;                   // f' (sum_s direct_s G_s) f of the last tick, N mm

    bool read_fields(GreensFunctions* const* greens);
    void read_field(GreensFunctions* const* greens, Node& at, bool& all) const;
    void advance_node(Node& n, const double (*driver)[3]) const;
    void drive(int i, const double* elastic, double (*out)[3], double direct[3]) const;
    void advance_products(const double* load, const double* elastic);
    void advance_loads(const double* load);
    int place_in_contact(int vertex) const;
    Node& history_of(int vertex);
    void merge_least();
    void drop(int k);
};

} // namespace palpate
