// A tissue model of your own in C++: Winkler's elastic foundation (E. Winkler, Die Lehre von der Elasticitaet und
// Festigkeit, 1867). Each node of the surface rests on a spring of its own, with a stiffness in proportion to its area;
// nodes do not act on each other. The 1 kHz loop calls relax() on its own thread.
#include "tissue/tissue_model.h"
#include <algorithm>
#include <cmath>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

namespace nb = nanobind;
using namespace palpate;

struct WinklerState : ModelState {
    std::vector<double> load; // (nodes) weights of one patch
};

class Winkler : public TissueModel {
    const std::vector<double> compliance; // (nodes) mm/N; 0: fixed

public:
    explicit Winkler(std::vector<double> compliance) : compliance(std::move(compliance)) {}
    int nodes() const override { return int(compliance.size()); }

    std::unique_ptr<ModelState> make_state() const override {
        auto state = std::make_unique<WinklerState>();
        state->u.assign(3 * compliance.size(), 0.0);
        state->load.assign(compliance.size(), 0.0);
        state->owner = this;
        return state;
    }

    // Least energy sum u_i^2 / 2 c_i with prescribed patch means d: u_i = c_i sum_a w_ai m_a, with multipliers m from
    // G m = d, G_ab = sum_i w_ai c_i w_bi. The tissue's force on tool a is -m_a.
    bool relax(ModelState& given, const ContactPatch* patches, int prescribed, int observed, double* displacement, int,
               double* force) const override {
        auto& state = static_cast<WinklerState&>(given);
        double G[max_patches][max_patches], m[max_patches][3];
        for (int a = 0; a < prescribed; a++) {
            for (int i = 0; i < patches[a].count; i++) state.load[patches[a].node[i]] = patches[a].weight[i];
            for (int b = 0; b < prescribed; b++) {
                G[a][b] = 0;
                for (int i = 0; i < patches[b].count; i++) {
                    const int node = patches[b].node[i];
                    G[a][b] += patches[b].weight[i] * compliance[node] * state.load[node];
                }
            }
            for (int i = 0; i < patches[a].count; i++) state.load[patches[a].node[i]] = 0;
            std::copy_n(displacement + 3 * a, 3, m[a]);
        }
        if (!solve(G, m, prescribed)) return false;
        std::fill(state.u.begin(), state.u.end(), 0.0);
        for (int a = 0; a < prescribed; a++)
            for (int k = 0; k < 3; k++) {
                force[3 * a + k] = -m[a][k];
                for (int i = 0; i < patches[a].count; i++) {
                    const int node = patches[a].node[i];
                    state.u[3 * size_t(node) + k] += compliance[node] * patches[a].weight[i] * m[a][k];
                }
            }
        observe_patches(state, patches, prescribed, observed, displacement, force);
        return true;
    }

private:
    // G m = right side, in place, by elimination; false if the patches are linearly dependent.
    static bool solve(double G[max_patches][max_patches], double m[max_patches][3], int n) {
        double size[max_patches];
        for (int a = 0; a < n; a++) size[a] = G[a][a];
        for (int a = 0; a < n; a++) {
            if (!(G[a][a] > 1e-9 * size[a])) return false;
            for (int b = a + 1; b < n; b++) {
                const double factor = G[b][a] / G[a][a];
                for (int c = a; c < n; c++) G[b][c] -= factor * G[a][c];
                for (int k = 0; k < 3; k++) m[b][k] -= factor * m[a][k];
            }
        }
        for (int a = n - 1; a >= 0; a--)
            for (int k = 0; k < 3; k++) {
                for (int b = a + 1; b < n; b++) m[a][k] -= G[a][b] * m[b][k];
                m[a][k] /= G[a][a];
            }
        return true;
    }
};

NB_MODULE(winkler_core, module) {
    nb::module_::import_("palpate._core"); // knows the base class
    using Compliance = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
    nb::class_<Winkler, TissueModel>(module, "Winkler").def("__init__", [](Winkler* self, Compliance compliance) {
        new (self) Winkler({compliance.data(), compliance.data() + compliance.size()});
    });
}
