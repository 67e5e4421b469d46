#include "bindings/tissue.h"
#include "multirate/linear_multirate_model.h"
#include "multirate/multirate_model.h"

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
            [](LinearMultirateModel* self, const MultigridModel& model, int interval) {
                expect(within(interval, 1, 10'000), "interval: 1 to 10000 ticks");
                new (self) LinearMultirateModel(model, interval);
            },
            "model"_a, "interval"_a, nb::keep_alive<1, 2>());
}
