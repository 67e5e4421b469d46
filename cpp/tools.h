#pragma once
#include "model.h"
#include "partial.h"
#include <vector>

namespace palpate {

// Solves with the factored stiffness of the nodes that may move; single precision, since it only preconditions. Vectors
// are the whole mesh's, (nodes, 3), zero on held nodes. Sized once.
class RestSolve {
public:
    // moving: the mesh's number of each node of the factor. value: the factor, rounded.
    RestSolve(const Supernodes& tree, const float* value, const std::vector<int>& moving, int nodes);

    void solve(const double* load, double* out); // out = K^-1 load
    // Three columns, (3, nodes, 3) one after the other: the displacements under unit forces along x, y and z spread
    // over the patch.
    void spread(const Patch& patch, double* out);

private:
    const Supernodes& tree;
    const float* value;
    const std::vector<int>& moving;
    const int nodes;
    std::vector<int> place; // of each node of the mesh in the factor, or -1
    std::vector<int> all;   // every supernode
    Substitution<float> one;
    PartialSolve<float> eight;
    std::vector<int> wanted; // every node of the factor
    std::vector<int> touched;
    std::vector<float> load, answer;
};

// The tools on a tissue: each prescribes its patch's weighted mean displacement, W'u = d. Keeps K^-1 W, so that a
// displacement can be moved to where the tools are in the way that costs least energy at rest, and a direction be made
// one along which no tool moves. Sized once.
class Tools {
public:
    Tools(int nodes, int most);

    // Takes over patches; true if they differ from those before. `sound` says whether they can be told apart.
    bool take(const Patch* patches, int contacts, RestSolve& rest);
    bool sound = true;
    int count() const { return contacts; }

    void means(const double* u, double* out) const;   // out = W'u, (contacts, 3)
    void reach(const double* gap, double* out) const; // out = K^-1 W C^-1 gap, C = W'K^-1 W
    void still(double* v) const;                      // v -= K^-1 W C^-1 W'v: W'v = 0 then
    void release(double* g, double* force) const;     // force = C^-T W'K^-1 g, g -= W force

private:
    const int n, most;
    int contacts = 0;
    std::vector<Patch> patch;
    std::vector<double> columns; // K^-1 W, (3 contacts, unknowns)
    std::vector<double> inverse; // of C, (3 contacts, 3 contacts)
    std::vector<double> work;
    mutable std::vector<double> mean;
    bool invert();
};

} // namespace palpate
