#pragma once
// What a body remembers of the loads on it. ComplianceModel uses it in the loop's thread.
#include "compliance/load_recursion.h"
#include "compliance/patch_blocks.h"

namespace palpate {

// If the whole stiffness relaxes alike, the displacement is u = G p at any time, where the elastic loads p differ from
// zero at nodes that have been touched, until they have decayed there. Each such node keeps p and the forces h_k of the
// branches, whose sum p + sum h_k is the force on it: that of the tools, or zero. So a dent lasts after the tool has
// left, and another tool finds it. G p and G h_k are followed at the vertices of the contact alone. What lags behind
// its loads obeys another recursion of the same kind.
class LoadHistory {
public:
    static constexpr int capacity = 1024; // nodes; if they are more, the least is added to its nearest
    static constexpr int max_fields = LoadRecursion::max_fields;

    LoadHistory(const FactoredStiffness& stiffness, const LoadRecursion& recursion);

    // --- a tick, in this order
    // The contact's vertices, ascending: true if all their displacements due to the history are known. The blocks that
    // this needs are read if `may_read`.
    bool enter(GreensFunctions& greens, const int* vertices, int count, bool may_read);
    // The displacement, mm, of the contact's vertex i if no force acted at the end of this tick.
    void free_displacement(int i, double out[3]) const;
    // A tick with these loads f (contact's vertices, 3) N on the tissue and the elastic displacements G f, mm. If those
    // are not known but guessed, the next enter() that finds the blocks mends the vertices' displacements.
    void advance(const double* load, const double* elastic, bool known);
    // The displacement of the contact's vertex i as it is now: after advance(), at the end of the tick.
    const double* displacement(int i) const { return contact[i].value[0]; }
    double energy() const; // N mm, of all springs: what could be regained

    // --- for a display, and to compute tables
    int size() const { return int(node.size()); }
    int vertex(int k) const { return node[k].vertex; }
    int slot_of(int vertex) const { return slot[vertex]; }
    bool touched(int k) const;                                           // by the contact
    const double* elastic_load(int k) const { return node[k].value[0]; } // N

    void reset();
    // All numbers that later answers depend on, appended.
    void append_to(std::vector<double>& numbers) const;
    size_t most_numbers() const;

    const LoadRecursion recursion;

private:
    struct Node { // of the history: p and h_k, N; of the contact: G p and G h_k, mm
        int vertex = -1;
        bool known = true;
        double value[max_fields][3] = {};
    };
    const FactoredStiffness& stiffness;
    std::vector<Node> node, contact, entering;
    std::vector<int> slot;                       // (vertices) place in `node`, or -1
    double peak = 0;                             // N, the largest load of a node yet
    double product[max_fields][max_fields] = {}; // of p and h_k: a' G b, N mm

    bool read_fields(GreensFunctions& greens);
    void advance_node(Node& n, const double driver[3]) const;
    void advance_products(const double* load, const double* elastic);
    void advance_loads(const double* load);
    int place_in_contact(int vertex) const;
    Node& history_of(int vertex);
    void merge_least();
    void drop(int k);
};

} // namespace palpate
