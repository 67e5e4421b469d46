#include "tissue/tissue_model.h"
#include <doctest.h>

using namespace palpate;

namespace {

// The smallest model: a bed of independent springs of k N/mm (Winkler), one per node. Writes what the interface demands
// and leaves the rest to its defaults. One tool: u_i = w_i d / sum w^2, force = -k d / sum w^2.
class SpringBed : public TissueModel {
public:
    static constexpr double k = 0.2;
    int nodes() const override { return 6; }
    std::unique_ptr<ModelState> make_state() const override {
        auto state = std::make_unique<ModelState>();
        state->owner = this;
        state->u.assign(3 * nodes(), 0);
        return state;
    }
    bool relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed, double* displacement, int,
               double* force) const override {
        if (prescribed > 1) return false;
        state.reset();
        double square = 0;
        for (int i = 0; prescribed == 1 && i < patches->count; i++) square += patches->weight[i] * patches->weight[i];
        for (int c = 0; c < 3 * prescribed; c++) {
            force[c] = -k * displacement[c] / square;
            for (int i = 0; i < patches->count; i++)
                state.u[3 * patches->node[i] + c] = patches->weight[i] * displacement[c] / square;
        }
        observe_patches(state, patches, prescribed, observed, displacement, force);
        return true;
    }
};

ContactPatch patch(int first, double a, double b) {
    ContactPatch out;
    out.count = 2;
    out.node[0] = first, out.node[1] = first + 1;
    out.weight[0] = a, out.weight[1] = b;
    return out;
}

} // namespace

TEST_CASE("a model of its own: observed patches, energy, display and rest follow from relax") {
    const SpringBed model, other;
    auto state = model.make_state();
    CHECK(model.owns(*state));
    CHECK_FALSE(other.owns(*state));
    const ContactPatch patches[2] = {patch(1, 0.5, 0.5), patch(2, 0.75, 0.25)}; // they share node 2
    double displacement[6] = {0, 0, -2, 9, 9, 9}, force[6] = {9, 9, 9, 9, 9, 9};
    REQUIRE(model.relax(*state, patches, 1, 1, displacement, 1, force));
    CHECK(force[2] == doctest::Approx(2 * 2 * SpringBed::k)); // two springs of 2 mm, against the push
    CHECK(force[2] * displacement[2] < 0);
    CHECK(displacement[5] == doctest::Approx(-1.5)); // 0.75 of node 2, which moves by 2 mm
    CHECK(displacement[3] == 0);
    for (int c = 3; c < 6; c++) CHECK(force[c] == 0);
    CHECK(model.energy(*state, 1, displacement, force) == doctest::Approx(2 * 0.5 * SpringBed::k * 4));
    const int shown[2] = {2, 5};
    float display[6];
    std::vector<double> all(3 * model.nodes());
    model.displayed_displacement(*state, shown, 2, display);
    model.displacement(*state, all.data());
    CHECK(display[2] == doctest::Approx(-2));
    CHECK(display[5] == 0);
    CHECK(all == state->u);
    model.begin_realtime(*state);
    CHECK(state->tables == TablePolicy::background);
    model.end_realtime(*state);
    CHECK(state->tables == TablePolicy::on_demand);
    state->reset();
    for (double x : state->state_vector()) CHECK(x == 0);
}

TEST_CASE("a patch copies the entries in use only") {
    ContactPatch from = patch(3, 0.4, 0.6), to;
    to.node[2] = 77;
    to.copy(from);
    CHECK(to.count == 2);
    CHECK(to.node[1] == 4);
    CHECK(to.weight[0] == 0.4);
    CHECK(to.node[2] == 77);
}
