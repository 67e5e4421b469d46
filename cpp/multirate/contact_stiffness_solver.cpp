#include "multirate/contact_stiffness_solver.h"
#include "base/vec3.h"

namespace palpate {
namespace {

constexpr int first_iterations = 8; // of contacts that have just closed

} // namespace

StiffnessAnswer ContactStiffnessSolver::blank() const {
    StiffnessAnswer answer;
    answer.u.assign(3 * size_t(StiffnessAnswer::most) * model.nodes(), 0.0f);
    return answer;
}

void ContactStiffnessSolver::solve(const StiffnessRequest& request, StiffnessAnswer& answer) {
    const int n = 3 * request.contacts;
    const bool fresh = request.serial != serial;
    serial = answer.serial = request.serial;
    answer.contacts = request.contacts;
    while (int(column.size()) < n) column.push_back(model.make_state());
    for (int k = 0; k < n; k++) {
        double d[StiffnessAnswer::most] = {}, force[StiffnessAnswer::most];
        d[k] = 1;
        if (fresh) column[k]->reset();
        answer.good =
            model.relax(*column[k], request.patch, request.contacts, 0, d, fresh ? first_iterations : 1, force);
        if (!answer.good) return;
        const std::vector<double>& u = column[k]->u;
        std::copy(u.begin(), u.end(), answer.u.begin() + size_t(k) * u.size());
    }
    for (int k = 0; k < n; k++)
        for (int j = 0; j <= k; j++) {
            const auto &a = static_cast<const MultigridState&>(*column[k]),
                       &b = static_cast<const MultigridState&>(*column[j]);
            const int size = int(a.solution.size());
            answer.stiffness[n * k + j] = answer.stiffness[n * j + k] =
                0.5 * (dot(a.solution.data(), b.Ku.data(), size) + dot(b.solution.data(), a.Ku.data(), size));
        }
}

} // namespace palpate
