#include "base/all_finite.h"
#include "base/instruction_set.h"
#include "base/platform.h"
#include "base/scratch_memory.h"
#include "base/thread_pool.h"
#include "bindings/module.h"
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

using namespace nb::literals;
using namespace palpate;

namespace {

// NumPy's structures for allocators of one's own (NEP 49), and where its table of functions has the one that sets them.
// They are part of its stable interface; its headers are not needed to build.
struct Allocator {
    void* context;
    void* (*malloc)(void*, size_t);
    void* (*calloc)(void*, size_t, size_t);
    void* (*realloc)(void*, void*, size_t);
    void (*free)(void*, void*, size_t);
};
struct Handler {
    char name[127];
    uint8_t version;
    Allocator allocator;
};
constexpr int set_handler = 304;

Handler handler = {"palpate_scratch",
                   1,
                   {nullptr, [](void*, size_t size) { return scratch_malloc(size); },
                    [](void*, size_t count, size_t size) { return scratch_calloc(count * size); },
                    [](void*, void* memory, size_t size) { return scratch_realloc(memory, size); },
                    [](void*, void* memory, size_t) { scratch_free(memory); }}};

// Sets NumPy's allocator, None for its own, of the running context. Returns the one before. api: NumPy's table.
nb::object set_allocator(nb::object api, nb::object allocator) {
    void** table = static_cast<void**>(PyCapsule_GetPointer(api.ptr(), nullptr));
    if (!table) throw nb::python_error();
    PyObject* before =
        reinterpret_cast<PyObject* (*)(PyObject*)>(table[set_handler])(allocator.is_none() ? nullptr : allocator.ptr());
    if (!before) throw nb::python_error();
    return nb::steal(before);
}

} // namespace

void bind_base(nb::module_& m) {
    m.def("threads", &threads, "Number of threads the kernels use.");
    m.def("set_threads", &set_threads, "n"_a, "Sets the number of threads; 0 gives back the default.");
    m.def(
        "set_background_niceness",
        [](int niceness) {
            expect(within(niceness, 0, 19), "niceness: 0 to 19");
            set_background_niceness(niceness);
        },
        "niceness"_a, "How far threads that are made from now on to compute ahead stand below ordinary ones.");
    m.def("instruction_set", &instruction_set, "The version of the hot kernels that this machine runs.");
    m.def(
        "all_finite", [](In<float, 1> values) { return all_finite(values.data(), int64_t(values.size())); },
        "values"_as_is, nb::call_guard<nb::gil_scoped_release>(), "Whether every value is a number and finite.");
    m.def("set_scratch", &set_scratch, "folder"_a, "limit"_a,
          "From now on at most `limit` bytes of large arrays lie in memory, the others in files there.");
    m.def(
        "scratch_use",
        [] {
            const ScratchUse use = scratch_use();
            return std::make_tuple(use.in_memory, use.in_files, use.most_in_memory, use.most_in_files, use.error);
        },
        "Bytes in memory and in files, now and at most, and the error of the last file that could not be made.");
    m.def("scratch_limit", &scratch_limit,
          "Bytes of large arrays that lie in memory at most; 2**64 - 1 where there is no limit.");
    nb::enum_<Passing>(m, "Passing", "What a pass does with a part of an array.")
        .value("read", Passing::read)
        .value("written", Passing::written)
        .value("done", Passing::done);
    m.def(
        "pass_over",
        [](In<float, 3> part, Passing how) { pass(const_cast<float*>(part.data()), part.size() * sizeof(float), how); },
        "part"_as_is, "how"_a, nb::call_guard<nb::gil_scoped_release>(),
        "Tells the system of slices of a volume that lies in a file; of other arrays nothing happens.");
    m.def(
        "scratch_allocator", [] { return nb::capsule(&handler, "mem_handler"); },
        "NumPy's handle of the memory that set_scratch limits.");
    m.def("set_allocator", &set_allocator, "api"_a, "allocator"_a.none(),
          "Sets NumPy's allocator in this context, None for its own; returns the one before.");
}
