#include "bindings/tissue.h"
#include "multirate/linear_multirate_model.h"
#include "multirate/multirate_model.h"
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

void bind_multirate(nb::module_& m) {
    nb::class_<MultirateModel, TissueModel>(m, "MultirateModel", "Finite strain beside the loop, linear forces in it.")
        .def(
            "__init__",
            [](MultirateModel* self, const ComplianceModel& linear, const HyperelasticModel& finite, int interval,
               double stride) {
                expect(linear.nodes() == finite.nodes(), "models: of two tissues");
                expect(within(interval, 1, 10'000), "interval: 1 to 10000 ticks");
                expect(stride > 0, "stride: more than 0 mm");
                new (self) MultirateModel(linear, finite, interval, stride);
            },
            "linear"_a, "finite"_a, "interval"_a, "stride"_a, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>());
    nb::class_<LinearMultirateModel, TissueModel>(m, "LinearMultirateModel",
                                                  "Multigrid beside the loop, the stiffness of the contacts in it.")
        .def(
            "__init__",
            [](LinearMultirateModel* self, const MultigridModel& model, int interval, In<double, 2> nodes,
               In<double, 1> shear, const std::vector<ContactPatch>& samples) {
                expect(within(interval, 1, 10'000), "interval: 1 to 10000 ticks");
                expect_vectors(nodes, size_t(model.nodes()), "nodes: expected shape (nodes, 3)");
                expect(shear.size() == size_t(model.nodes()), "shear: expected one of each node");
                check_nodes(model, samples);
                nb::gil_scoped_release free;
                new (self) LinearMultirateModel(model, interval, {nodes.data(), nodes.data() + nodes.size()},
                                                {shear.data(), shear.data() + shear.size()}, samples);
            },
            "model"_a, "interval"_a, "nodes"_as_is, "shear"_as_is, "samples"_a, nb::keep_alive<1, 2>());
}
