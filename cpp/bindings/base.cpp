#include "base/all_finite.h"
#include "base/instruction_set.h"
#include "base/thread_pool.h"
#include "bindings/module.h"

using namespace nb::literals;
using namespace palpate;

void bind_base(nb::module_& m) {
    m.def("threads", &threads, "Number of threads the kernels use.");
    m.def("set_threads", &set_threads, "n"_a, "Sets the number of threads; 0 gives back the default.");
    m.def("instruction_set", &instruction_set, "The version of the hot kernels that this machine runs.");
    m.def(
        "all_finite", [](In<float, 1> values) { return all_finite(values.data(), int64_t(values.size())); },
        "values"_as_is, nb::call_guard<nb::gil_scoped_release>(), "Whether every value is a number and finite.");
}
