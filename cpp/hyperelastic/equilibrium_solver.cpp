#include "hyperelastic/equilibrium_solver.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int most_steps = 40;
// Of u, in the energy norm; the error of the force is of second order in it.
constexpr double tolerance = 0.02, moving_tolerance = 0.08;
constexpr int response_steps = 2, moving_response_steps = 1;
constexpr int response_interval = 4; // solutions of a moving tool between two responses
constexpr double most_slid = 0.3;    // change of a force by sliding, over that by its tool's way
constexpr int most = LocalForce::most;

} // namespace

EquilibriumSolver::EquilibriumSolver(const HyperelasticModel& model, std::vector<int> vertices)
    : model(model), vertices(std::move(vertices)),
      state(static_cast<HyperelasticState*>(model.make_state().release())) {
    state->response = std::make_unique<ContactResponse>(model.nodes(), TissueModel::max_patches);
}

EquilibriumAnswer EquilibriumSolver::blank() const {
    EquilibriumAnswer answer;
    answer.u.assign(3 * size_t(model.nodes()), 0.0);
    answer.response.assign(3 * LocalForce::most * vertices.size(), 0.0f);
    return answer;
}

void EquilibriumSolver::solve(const EquilibriumRequest& request, EquilibriumAnswer& answer) {
    HyperelasticState& s = *state;
    if (request.from_rest) {
        s.reset();
        s.response->clear();
    }
    answer.serial = request.serial;
    answer.tick = request.tick;
    double force[most];
    const double aim = request.moving ? moving_tolerance : tolerance;
    const int steps = model.solve(s, request.patch, request.contacts, request.displacement, most_steps, aim, force);
    answer.good = steps >= 0;
    if (!answer.good) return;
    const ContactResponse& response = *s.response;
    LocalForce& local = answer.local = LocalForce();
    const int n = 3 * request.contacts;
    s.constraints.patch_means(s.current.u.data(), local.displacement);
    const bool follows = !request.from_rest && n == known;
    if (request.moving && follows && since_response < response_interval) {
        model.read_response(s);
        since_response++;
    } else {
        model.respond(s, request.moving ? moving_response_steps : response_steps);
        std::copy_n(response.stiffness.data(), n * n, stiffness);
        since_response = 1;
    }
    double linear[most * most];
    s.constraints.rest_stiffness(linear);
    if (request.moving && follows) update_stiffness(n, local.displacement, linear);
    known = n;
    std::copy_n(linear, n * n, last_linear);
    std::copy_n(local.displacement, n, displacement);
    std::copy_n(response.force.data(), n, last_force);
    local.contacts = request.contacts;
    local.energy = s.current.energy;
    local.stiffens = s.current.stiffened > 0;
    local.linear_work = 0;
    answer.error = response.error;
    for (int i = 0; i < n; i++) {
        local.gradient[i] = response.force[i];
        for (int j = 0; j < n; j++) {
            local.curvature[n * i + j] = stiffness[n * i + j] - linear[n * i + j];
            local.gradient[i] -= linear[n * i + j] * local.displacement[j];
            local.linear_work += local.displacement[i] * linear[n * i + j] * local.displacement[j];
        }
    }
    local.energy -= 0.5 * local.linear_work;
    std::copy(s.current.u.begin(), s.current.u.end(), answer.u.begin());
    float* out = answer.response.data();
    for (int k = 0; k < n; k++)
        for (int v : vertices)
            for (int c = 0; c < 3; c++) *out++ = float(response.columns[size_t(k) * s.u.size() + 3 * size_t(v) + c]);
}

// Along the tools' way the stiffness becomes that between the last two solutions, symmetric (M. J. D. Powell, 1970).
// A contact that slides changes its force without a way of its tool: by as much as linear elasticity says, and where
// that is not small against what the way does, nothing is learnt of the stiffness.
void EquilibriumSolver::update_stiffness(int n, const double* now, const double* linear) {
    double way[most], off[most], square = 0, along = 0, slid = 0, moved = 0;
    for (int k = 0; k < n; k++) way[k] = now[k] - displacement[k], square += way[k] * way[k];
    if (!(square > 1e-12)) return;
    for (int i = 0; i < n; i++) {
        double by_slide = 0, by_way = 0;
        for (int j = 0; j < n; j++) {
            by_slide += (linear[n * i + j] - last_linear[n * i + j]) * displacement[j];
            by_way += stiffness[n * i + j] * way[j];
        }
        off[i] = state->response->force[i] - last_force[i] - by_slide - by_way;
        slid += by_slide * by_slide, moved += by_way * by_way;
        along += off[i] * way[i];
    }
    if (slid > most_slid * most_slid * moved) return;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            stiffness[n * i + j] += (off[i] * way[j] + way[i] * off[j] - along / square * way[i] * way[j]) / square;
}

} // namespace palpate
